"""A lesson in the package `cfreg`, and the same job with Open3D's API."""
