"""A task in the browser: dragged, planned and watched. `Session` is what a page shows; `view` shows it, by viser."""
