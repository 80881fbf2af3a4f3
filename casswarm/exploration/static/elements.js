// Elements of the page, and numbers for reading.

const SVG = "http://www.w3.org/2000/svg";

/** An element with attributes (functions are listeners) and children. */
function make(tag, attributes = {}, ...children) {
  const vector = ["svg", "g", "circle", "path", "polyline", "polygon", "text", "title"].includes(tag);
  const element = vector ? document.createElementNS(SVG, tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value !== false && value !== null) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** A number for reading, with the given significant digits. */
const short = (value, digits = 3) => String(Number(Number(value).toPrecision(digits)));
const floor4 = (value) => (Math.floor(value * 1e4 + 1e-9) / 1e4).toFixed(4);
const ceil4 = (value) => (Math.ceil(value * 1e4 - 1e-9) / 1e4).toFixed(4);
