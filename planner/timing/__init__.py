"""From paths and solutions to trajectories on the tick grid."""
