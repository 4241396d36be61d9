// PCL's keypoints of a cloud, as plain text.
//
//   keypoints CLOUD OUT THINNED sift MIN_SCALE OCTAVES SCALES MIN_CONTRAST
//   keypoints CLOUD OUT - iss SALIENT_RADIUS NON_MAX_RADIUS GAMMA21 GAMMA32 MIN_NEIGHBORS
//
// CLOUD has one point a line: x y z value, the value such as its curvature; ISS does not
// look at it. OUT receives x y z scale a keypoint of SIFT, whose scale tells its octave,
// and the indices of ISS. THINNED receives octave x y z value: the cloud of every octave
// as PCL's voxel grid makes it, so that each stage is judged alone.

#include <cstdlib>
#include <iostream>

#include <pcl/filters/voxel_grid.h>
#include <pcl/keypoints/iss_3d.h>
#include <pcl/keypoints/sift_keypoint.h>

#include "text.hpp"

namespace {

using Points = pcl::PointCloud<pcl::PointXYZI>;

void sift(const Points::ConstPtr& points, const std::string& out, const std::string& thinned,
          char** settings) {
  const float min_scale = std::strtof(settings[0], nullptr);
  const int octaves = std::atoi(settings[1]);
  pcl::SIFTKeypoint<pcl::PointXYZI, pcl::PointWithScale> detector;
  detector.setInputCloud(points);
  detector.setScales(min_scale, octaves, std::atoi(settings[2]));
  detector.setMinimumContrast(std::strtof(settings[3], nullptr));
  pcl::PointCloud<pcl::PointWithScale> found;
  detector.compute(found);
  auto file = text::write(out);
  for (const auto& p : found) {
    file << p.x << ' ' << p.y << ' ' << p.z << ' ' << p.scale << '\n';
  }
  auto stages = text::write(thinned);
  auto cloud = points;
  float scale = min_scale;
  for (int octave = 0; octave < octaves; ++octave, scale *= 2) {
    pcl::VoxelGrid<pcl::PointXYZI> grid;
    grid.setLeafSize(scale, scale, scale);
    grid.setInputCloud(cloud);
    const auto means = pcl::make_shared<Points>();
    grid.filter(*means);
    cloud = means;
    for (const auto& p : *cloud) {
      stages << octave << ' ' << p.x << ' ' << p.y << ' ' << p.z << ' ' << p.intensity << '\n';
    }
  }
}

void iss(const Points::ConstPtr& points, const std::string& out, char** settings) {
  pcl::ISSKeypoint3D<pcl::PointXYZI, pcl::PointXYZI> detector;
  detector.setInputCloud(points);
  detector.setSalientRadius(std::atof(settings[0]));
  detector.setNonMaxRadius(std::atof(settings[1]));
  detector.setThreshold21(std::atof(settings[2]));
  detector.setThreshold32(std::atof(settings[3]));
  detector.setMinNeighbors(std::atoi(settings[4]));
  Points found;
  detector.compute(found);
  auto file = text::write(out);
  for (const auto index : detector.getKeypointsIndices()->indices) {
    file << index << '\n';
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::string kind = argc > 4 ? argv[4] : "";
  if (!(kind == "sift" && argc == 9) && !(kind == "iss" && argc == 10)) {
    std::cerr << "usage: keypoints CLOUD OUT THINNED sift MIN_SCALE OCTAVES SCALES MIN_CONTRAST\n"
                 "       keypoints CLOUD OUT - iss SALIENT_RADIUS NON_MAX_RADIUS GAMMA21 GAMMA32 "
                 "MIN_NEIGHBORS\n";
    return 2;
  }
  try {
    const auto points = text::read_with_values(argv[1]);
    if (kind == "sift") {
      sift(points, argv[2], argv[3], argv + 5);
    } else {
      iss(points, argv[2], argv + 5);
    }
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
  return 0;
}
