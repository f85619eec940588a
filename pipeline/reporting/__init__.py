"""Reporting: tables, figures, stills and Markdown pages."""
