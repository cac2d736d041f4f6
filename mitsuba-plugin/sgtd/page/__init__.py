"""What pages of reports share: how plots look, how a template becomes one file, how numbers are written."""
