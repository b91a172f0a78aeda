"""Figures of the report: charts, pictures of shapes and hands, 3-D views."""
