"""From packets to pictures: order, animate, warp the background, render."""
