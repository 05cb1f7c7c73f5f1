"""Tools of authors: layouts, light copies of datasets, figures, Habitat's episode files."""
