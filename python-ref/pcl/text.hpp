// Clouds and results of these programs as plain text: one point a line.

#pragma once

#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

namespace text {

/// Reads lines of x y z value.
inline pcl::PointCloud<pcl::PointXYZI>::Ptr read_with_values(const std::string& path) {
  std::ifstream file(path);
  const auto points = pcl::make_shared<pcl::PointCloud<pcl::PointXYZI>>();
  pcl::PointXYZI p;
  while (file >> p.x >> p.y >> p.z >> p.intensity) {
    points->push_back(p);
  }
  if (points->empty() || !file.eof()) {
    throw std::runtime_error(path + ": expected lines of four numbers");
  }
  return points;
}

/// Reads lines of x y z.
inline pcl::PointCloud<pcl::PointXYZ>::Ptr read(const std::string& path) {
  std::ifstream file(path);
  const auto points = pcl::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  pcl::PointXYZ p;
  while (file >> p.x >> p.y >> p.z) {
    points->push_back(p);
  }
  if (points->empty() || !file.eof()) {
    throw std::runtime_error(path + ": expected lines of three numbers");
  }
  return points;
}

/// A file in which f32 numbers keep all their digits.
inline std::ofstream write(const std::string& path) {
  std::ofstream file(path);
  file.precision(std::numeric_limits<float>::max_digits10);
  return file;
}

}  // namespace text
