"""`dynamics app`: a local web page on which clips become scenes, by the standard library's web server (docs/app.md)."""
