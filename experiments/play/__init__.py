"""Take the stick: a page that is played in a browser, what it leaves behind, and studies of persons who played it."""
