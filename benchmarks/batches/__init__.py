"""Batches through both engines, with kills: identical answers, nothing lost, nothing twice; and what a plan costs."""
