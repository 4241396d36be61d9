// PCL's global registration of a pair, by the settings of its tutorial "Robust pose estimation of
// rigid objects" in units of a voxel: voxel grid, normals, FPFH, SampleConsensusPrerejective.
//
//   prerejective SOURCE TARGET VOXEL SX SY SZ TX TY TZ
//
// SOURCE and TARGET have one point a line: x y z; the six last numbers are the places that their
// normals face. One line goes to standard output: the seconds from the points to the pose, and
// the pose from source to target as 16 numbers, row by row, where PCL tells that it has one.

#include <chrono>
#include <cstdlib>
#include <iostream>
#include <limits>

#include <pcl/features/fpfh_omp.h>
#include <pcl/features/normal_3d_omp.h>
#include <pcl/filters/filter.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/registration/sample_consensus_prerejective.h>

#include "text.hpp"

namespace {

using Points = pcl::PointCloud<pcl::PointXYZ>;
using Surface = pcl::PointCloud<pcl::PointNormal>;
using Features = pcl::PointCloud<pcl::FPFHSignature33>;
using Alignment = pcl::SampleConsensusPrerejective<pcl::PointNormal, pcl::PointNormal,
                                                   pcl::FPFHSignature33>;

/// The means of the voxels, with normals from all points within one voxel.
Surface::Ptr thinned(const Points::ConstPtr& points, float voxel, char** place) {
  const auto means = pcl::make_shared<Points>();
  pcl::VoxelGrid<pcl::PointXYZ> grid;
  grid.setLeafSize(voxel, voxel, voxel);
  grid.setInputCloud(points);
  grid.filter(*means);

  const auto surface = pcl::make_shared<Surface>();
  pcl::NormalEstimationOMP<pcl::PointXYZ, pcl::PointNormal> estimation;
  estimation.setInputCloud(means);
  estimation.setSearchSurface(points);
  estimation.setRadiusSearch(voxel);
  estimation.setViewPoint(std::strtof(place[0], nullptr), std::strtof(place[1], nullptr),
                          std::strtof(place[2], nullptr));
  estimation.compute(*surface);
  for (std::size_t i = 0; i < means->size(); ++i) {
    (*surface)[i].getVector3fMap() = (*means)[i].getVector3fMap();
  }
  // Where fewer than three points are near there is no normal, and no feature could be compared.
  pcl::Indices kept;
  pcl::removeNaNNormalsFromPointCloud(*surface, *surface, kept);
  return surface;
}

Features::Ptr described(const Surface::ConstPtr& surface, float voxel) {
  const auto features = pcl::make_shared<Features>();
  pcl::FPFHEstimationOMP<pcl::PointNormal, pcl::PointNormal, pcl::FPFHSignature33> description;
  description.setInputCloud(surface);
  description.setInputNormals(surface);
  description.setRadiusSearch(5 * voxel);
  description.compute(*features);
  return features;
}

void align(Alignment& alignment, const Surface::Ptr& source, const Surface::Ptr& target,
           float voxel) {
  alignment.setInputSource(source);
  alignment.setSourceFeatures(described(source, voxel));
  alignment.setInputTarget(target);
  alignment.setTargetFeatures(described(target, voxel));
  alignment.setMaximumIterations(50'000);
  alignment.setNumberOfSamples(3);
  alignment.setCorrespondenceRandomness(5);
  alignment.setSimilarityThreshold(0.9F);
  alignment.setMaxCorrespondenceDistance(2.5 * voxel);
  alignment.setInlierFraction(0.25F);
  std::srand(0);  // It samples by std::rand: the same pose every time.
  Surface moved;
  alignment.align(moved);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 10) {
    std::cerr << "usage: prerejective SOURCE TARGET VOXEL SX SY SZ TX TY TZ\n";
    return 2;
  }
  try {
    const auto source = text::read(argv[1]);
    const auto target = text::read(argv[2]);
    const float voxel = std::strtof(argv[3], nullptr);
    Alignment alignment;
    const auto begun = std::chrono::steady_clock::now();
    align(alignment, thinned(source, voxel, argv + 4), thinned(target, voxel, argv + 7), voxel);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begun;

    std::cout.precision(std::numeric_limits<float>::max_digits10);
    std::cout << took.count();
    if (alignment.hasConverged()) {
      const auto pose = alignment.getFinalTransformation();
      for (int i = 0; i < 16; ++i) {
        std::cout << ' ' << pose(i / 4, i % 4);
      }
    }
    std::cout << '\n';
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
  return 0;
}
