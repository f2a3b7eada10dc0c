"""The board: models compared by a frozen suite of drives, with one score, and a page that shows it."""
