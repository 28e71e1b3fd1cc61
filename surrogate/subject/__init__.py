"""Who drives the subject vehicle: its vType's model, another car-following model, a planner, or a logged drive."""
