"""Tables of measured motion as people have them: text of any separator, workbooks, Tracker's projects."""
