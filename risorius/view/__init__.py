"""The page that moves every actuator of a face by hand."""
