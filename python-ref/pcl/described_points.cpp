// The points and descriptors that the paper's implementation connects, all by PCL.
//
//   described_points CLOUD OUT K
//   described_points CLOUD OUT K MIN_SCALE OCTAVES SCALES MIN_CONTRAST
//
// CLOUD has one point a line: x y z. Normals from the K nearest points, seen from the
// origin; without the other settings FPFH at every point, with them at the SIFT keypoints
// of the curvature, from all points around. OUT receives x y z and 33 bins a line; the seconds
// that normals and descriptors took are printed.

#include <chrono>
#include <cstdlib>
#include <iostream>

#include <pcl/features/fpfh.h>
#include <pcl/features/normal_3d.h>
#include <pcl/keypoints/sift_keypoint.h>
#include <pcl/search/kdtree.h>

#include "text.hpp"

namespace {

using Points = pcl::PointCloud<pcl::PointXYZ>;
using Normals = pcl::PointCloud<pcl::Normal>;
using Tree = pcl::search::KdTree<pcl::PointXYZ>;

Points::Ptr keypoints(const Points& points, const Normals& normals, char** settings) {
  const auto curved = pcl::make_shared<pcl::PointCloud<pcl::PointXYZI>>();
  for (std::size_t i = 0; i < points.size(); ++i) {
    pcl::PointXYZI p;
    p.getVector3fMap() = points[i].getVector3fMap();
    p.intensity = normals[i].curvature;
    curved->push_back(p);
  }
  pcl::SIFTKeypoint<pcl::PointXYZI, pcl::PointXYZ> detector;
  detector.setInputCloud(curved);
  detector.setScales(std::strtof(settings[0], nullptr), std::atoi(settings[1]),
                     std::atoi(settings[2]));
  detector.setMinimumContrast(std::strtof(settings[3], nullptr));
  const auto found = pcl::make_shared<Points>();
  detector.compute(*found);
  return found;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4 && argc != 8) {
    std::cerr << "usage: described_points CLOUD OUT K [MIN_SCALE OCTAVES SCALES MIN_CONTRAST]\n";
    return 2;
  }
  try {
    const auto points = text::read(argv[1]);
    const int k = std::atoi(argv[3]);
    const auto begun = std::chrono::steady_clock::now();
    const auto tree = pcl::make_shared<Tree>();
    pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
    estimation.setInputCloud(points);
    estimation.setSearchMethod(tree);
    estimation.setKSearch(k);
    estimation.setViewPoint(0.0F, 0.0F, 0.0F);
    const auto normals = pcl::make_shared<Normals>();
    estimation.compute(*normals);

    const auto places = argc == 8 ? keypoints(*points, *normals, argv + 4) : points;
    pcl::FPFHEstimation<pcl::PointXYZ, pcl::Normal, pcl::FPFHSignature33> description;
    description.setInputCloud(places);
    description.setSearchSurface(points);
    description.setInputNormals(normals);
    description.setSearchMethod(tree);
    description.setKSearch(k);
    pcl::PointCloud<pcl::FPFHSignature33> signatures;
    description.compute(signatures);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begun;
    std::cout << took.count() << '\n';

    auto file = text::write(argv[2]);
    for (std::size_t i = 0; i < signatures.size(); ++i) {
      const auto& p = (*places)[i];
      file << p.x << ' ' << p.y << ' ' << p.z;
      for (const float bin : signatures[i].histogram) {
        file << ' ' << bin;
      }
      file << '\n';
    }
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
  return 0;
}
