"""Private helpers: files, processes, compiled modules, documents, text."""
