"""From packets to pictures: order, animate, render, composite."""
