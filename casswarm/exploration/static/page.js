// The local page of `casswarm explore`: the widget's module, with a WebSocket as its model.
import view from "./explore.js";

const socket = new WebSocket(new URL("socket", location.href.replace(/^http/, "ws")));
const model = {
  send: (message) => socket.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message)),
  on: (_, listener) => socket.addEventListener("message", (event) => listener(JSON.parse(event.data))),
  off: () => {},
  set: () => {},
  save_changes: () => {},
  silence: "casswarm explore does not answer; if it has ended, start it again and open its new address",
};
const place = document.getElementById("view");
socket.addEventListener("open", () => view.render({ model, el: place }));
socket.addEventListener("close", () => {
  const notice = place.querySelector(".csw-notice") || place;
  notice.textContent = "casswarm explore has ended; start it again and open its new address";
});
