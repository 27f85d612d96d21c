"""Neural networks and classical detectors: faces, landmarks, irises, person segmentation."""
