"""What a diagnosis found, for people: a page, a log to look at in three dimensions, a summary in the terminal."""
