"""A viewer in the browser: plans and executions played, queries changed and planned anew."""
