"""Pages in the browser: who gets in, messages of numbers, and the style that all pages share."""
