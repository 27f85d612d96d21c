"""The page that shows a call while it goes on, and takes the camera of who looks at it."""
