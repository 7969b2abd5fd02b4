"""The joint as a scene of rigid bodies: its parts, passes and refinement, and what is read off a run. No vibration."""
