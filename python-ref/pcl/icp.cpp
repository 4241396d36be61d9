// PCL's point-to-point ICP on many pairs of clouds.
//
//   icp PAIRS MAX_DISTANCE MAX_ITERATIONS TRANSFORMATION_EPSILON FITNESS_EPSILON
//
// PAIRS has two file names a line, source and target, each a cloud with one point a line:
// x y z. One line a pair goes to standard output: the pose from source to target as 16
// numbers, row by row, the iterations, and the number of the criterion that ended them
// (DefaultConvergenceCriteria::ConvergenceState).

#include <cstdlib>
#include <fstream>
#include <iostream>
#include <limits>
#include <stdexcept>
#include <string>

#include <pcl/point_types.h>
#include <pcl/registration/icp.h>

#include "text.hpp"

namespace {

using Points = pcl::PointCloud<pcl::PointXYZ>;

class Icp : public pcl::IterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ> {
 public:
  int iterations() const { return nr_iterations_; }
};

void align(const Points::ConstPtr& source, const Points::ConstPtr& target, char** settings) {
  Icp icp;
  icp.setInputSource(source);
  icp.setInputTarget(target);
  icp.setMaxCorrespondenceDistance(std::atof(settings[0]));
  icp.setMaximumIterations(std::atoi(settings[1]));
  icp.setTransformationEpsilon(std::atof(settings[2]));
  icp.setEuclideanFitnessEpsilon(std::atof(settings[3]));
  Points moved;
  icp.align(moved);
  const auto pose = icp.getFinalTransformation();
  for (int i = 0; i < 16; ++i) {
    std::cout << pose(i / 4, i % 4) << ' ';
  }
  std::cout << icp.iterations() << ' ' << icp.getConvergeCriteria()->getConvergenceState() << '\n';
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 6) {
    std::cerr << "usage: icp PAIRS MAX_DISTANCE MAX_ITERATIONS TRANSFORMATION_EPSILON "
                 "FITNESS_EPSILON\n";
    return 2;
  }
  std::cout.precision(std::numeric_limits<float>::max_digits10);
  try {
    std::ifstream pairs(argv[1]);
    std::string source;
    std::string target;
    while (pairs >> source >> target) {
      align(text::read(source), text::read(target), argv + 2);
    }
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
  return 0;
}
