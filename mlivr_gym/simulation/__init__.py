"""Dynamic simulation of plans in MuJoCo."""
