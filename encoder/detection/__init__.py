"""Where the face is: detectors, landmark networks, segmentation."""
