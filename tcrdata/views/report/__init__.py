"""The parts of the HTML report: each module draws one section from plain rows."""
