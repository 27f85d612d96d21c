"""Where decoded pictures go."""
