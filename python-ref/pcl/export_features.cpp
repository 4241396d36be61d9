// PCL's normals and FPFH of a cloud, as plain text.
//
//   export_features CLOUD K NORMALS FPFH
//
// CLOUD has one point a line: x y z nx ny nz. NORMALS receives what PCL estimates
// from the K nearest points, seen from the origin: nx ny nz curvature. FPFH receives
// 33 bins a line from the normals *given* in CLOUD, so that each stage is judged
// alone.

#include <cstdlib>
#include <fstream>
#include <iostream>
#include <limits>
#include <stdexcept>
#include <string>

#include <pcl/features/fpfh.h>
#include <pcl/features/normal_3d.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>

namespace {

using Points = pcl::PointCloud<pcl::PointXYZ>;
using Normals = pcl::PointCloud<pcl::Normal>;
using Tree = pcl::search::KdTree<pcl::PointXYZ>;

void read(const std::string& path, Points& points, Normals& normals) {
  std::ifstream file(path);
  pcl::PointXYZ p;
  pcl::Normal n;
  while (file >> p.x >> p.y >> p.z >> n.normal_x >> n.normal_y >> n.normal_z) {
    points.push_back(p);
    normals.push_back(n);
  }
  if (points.empty() || !file.eof()) {
    throw std::runtime_error(path + ": expected lines of six numbers");
  }
}

std::ofstream full_precision(const std::string& path) {
  std::ofstream file(path);
  file.precision(std::numeric_limits<float>::max_digits10);
  return file;
}

void write_normals(const Points::ConstPtr& points, const Tree::Ptr& tree, int k,
                   const std::string& path) {
  pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
  estimation.setInputCloud(points);
  estimation.setSearchMethod(tree);
  estimation.setKSearch(k);
  estimation.setViewPoint(0.0F, 0.0F, 0.0F);
  Normals result;
  estimation.compute(result);
  auto file = full_precision(path);
  for (const auto& n : result) {
    file << n.normal_x << ' ' << n.normal_y << ' ' << n.normal_z << ' ' << n.curvature << '\n';
  }
}

void write_fpfh(const Points::ConstPtr& points, const Normals::ConstPtr& normals,
                const Tree::Ptr& tree, int k, const std::string& path) {
  pcl::FPFHEstimation<pcl::PointXYZ, pcl::Normal, pcl::FPFHSignature33> estimation;
  estimation.setInputCloud(points);
  estimation.setInputNormals(normals);
  estimation.setSearchMethod(tree);
  estimation.setKSearch(k);
  pcl::PointCloud<pcl::FPFHSignature33> result;
  estimation.compute(result);
  auto file = full_precision(path);
  for (const auto& signature : result) {
    for (const float bin : signature.histogram) {
      file << bin << ' ';
    }
    file << '\n';
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) {
    std::cerr << "usage: export_features CLOUD K NORMALS FPFH\n";
    return 2;
  }
  try {
    const auto points = pcl::make_shared<Points>();
    const auto normals = pcl::make_shared<Normals>();
    read(argv[1], *points, *normals);
    const int k = std::atoi(argv[2]);
    const auto tree = pcl::make_shared<Tree>();
    write_normals(points, tree, k, argv[3]);
    write_fpfh(points, normals, tree, k, argv[4]);
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
  return 0;
}
