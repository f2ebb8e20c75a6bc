"""Work on triangles and convex parts: taking meshes apart, what two links share, what space is free."""
