"""The model of a live call: its versions, trained and learned mode by mode beside the frames."""

# The process that learns, see `runtime.child_process`.
LEARNING_PROCESS = "encoder.live_model.learning_process"
