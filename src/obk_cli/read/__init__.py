"""Tree -> typed config, with a finding for every key and value that the language does not have."""
