"""The model of a live call: its versions, trained and learned mode by mode beside the frames."""
