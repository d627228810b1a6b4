"""What a selection says, for people and programs: verdict, gap, tables, figures, page."""
