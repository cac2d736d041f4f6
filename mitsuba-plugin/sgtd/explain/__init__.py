"""``sgtd explain``: what each material of a scene costs, why, and what would make it cheaper."""
