"""small_gicp: the ICP family, and normals."""


def register(metric, source, target, max_distance, initial, neighbors, max_iterations, rotation_tolerance, translation_tolerance):
    """Pose by ICP from point to `point`, to `plane` or `generalized`; surfaces of so many neighbours."""
    import small_gicp

    source, target = (small_gicp.PointCloud(points) for points in (source, target))
    for cloud in (source, target):
        small_gicp.estimate_normals_covariances(cloud, num_neighbors=neighbors)
    return small_gicp.align(
        target,
        source,
        init_T_target_source=initial,
        registration_type={"point": "ICP", "plane": "PLANE_ICP", "generalized": "GICP"}[metric],
        max_correspondence_distance=max_distance,
        max_iterations=max_iterations,
        rotation_epsilon=rotation_tolerance,
        translation_epsilon=translation_tolerance,
    ).T_target_source


def normals(points, neighbors, threads):
    """Unit normals (N, 3), of either sign."""
    import small_gicp

    cloud = small_gicp.PointCloud(points.astype("float64"))
    tree = small_gicp.KdTree(cloud, num_threads=threads)
    small_gicp.estimate_normals(cloud, tree, num_neighbors=neighbors, num_threads=threads)
    return cloud.normals()[:, :3]
