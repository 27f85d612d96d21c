"""The person-specific appearance model: mean and modes, coded."""
