"""`nadrc live`: a page that shows and tunes a running loop, served beside the controller."""
