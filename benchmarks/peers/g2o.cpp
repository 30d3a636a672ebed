// g2o with Gauss-Newton. Variants: cholmod, eigen (its two sparse Cholesky solvers, both with a block AMD order: g2o has
// no nested dissection), careful (cholmod, with Levenberg-Marquardt).
#include <g2o/core/block_solver.h>
#include <g2o/core/optimization_algorithm_gauss_newton.h>
#include <g2o/core/optimization_algorithm_levenberg.h>
#include <g2o/core/sparse_optimizer.h>
#include <g2o/core/sparse_optimizer_terminate_action.h>
#include <g2o/solvers/cholmod/linear_solver_cholmod.h>
#include <g2o/solvers/eigen/linear_solver_eigen.h>
#include <g2o/types/slam2d/edge_se2.h>
#include <g2o/types/slam2d/edge_se2_pointxy.h>
#include <g2o/types/slam2d/vertex_point_xy.h>
#include <g2o/types/slam2d/vertex_se2.h>
#include <g2o/types/slam3d/edge_se3.h>
#include <g2o/types/slam3d/edge_se3_pointxyz.h>
#include <g2o/types/slam3d/parameter_se3_offset.h>
#include <g2o/types/slam3d/vertex_pointxyz.h>
#include <g2o/types/slam3d/vertex_se3.h>

#include <limits>
#include <memory>

#include "native.hpp"

namespace {

struct Plane {
  static constexpr int D = 2, turns = 1;
  using Pose = g2o::VertexSE2;
  using Point = g2o::VertexPointXY;
  using Step = g2o::EdgeSE2;
  using Sighting = g2o::EdgeSE2PointXY;
  using Blocks = g2o::BlockSolver<g2o::BlockSolverTraits<-1, -1>>;
  static g2o::SE2 pose(const double* T, const double* R) { return {T[0], T[1], std::atan2(R[2], R[0])}; }
  static Eigen::Matrix2d rotation(const g2o::SE2& x) { return x.rotation().toRotationMatrix(); }
  static double turn_information(double sigma) { return 1 / (sigma * sigma); }
};

struct Space {
  static constexpr int D = 3, turns = 3;
  using Pose = g2o::VertexSE3;
  using Point = g2o::VertexPointXYZ;
  using Step = g2o::EdgeSE3;
  using Sighting = g2o::EdgeSE3PointXYZ;
  using Blocks = g2o::BlockSolver<g2o::BlockSolverTraits<-1, -1>>;
  static Eigen::Isometry3d pose(const double* T, const double* R) {
    Eigen::Isometry3d x = Eigen::Isometry3d::Identity();
    x.linear() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R);
    x.translation() = Eigen::Map<const Eigen::Vector3d>(T);
    return x;
  }
  static Eigen::Matrix3d rotation(const Eigen::Isometry3d& x) { return x.rotation(); }
  // Its rotation error is the vector part of a quaternion: half the angle, near zero.
  static double turn_information(double sigma) { return 4 / (sigma * sigma); }
};

template <class World>
class Model {
  static constexpr int D = World::D;

 public:
  Model(const Problem& p, const std::string& variant) : p_(p) {
    using Matrix = typename World::Blocks::PoseMatrixType;
    std::unique_ptr<g2o::LinearSolver<Matrix>> linear;
    if (variant == "eigen")
      linear = std::make_unique<g2o::LinearSolverEigen<Matrix>>();
    else
      linear = std::make_unique<g2o::LinearSolverCholmod<Matrix>>();
    auto blocks = std::make_unique<typename World::Blocks>(std::move(linear));
    if (variant == "careful")
      algorithm_ = std::make_shared<g2o::OptimizationAlgorithmLevenberg>(std::move(blocks));
    else
      algorithm_ = std::make_shared<g2o::OptimizationAlgorithmGaussNewton>(std::move(blocks));
    graph_.setAlgorithm(algorithm_);
    auto enough = std::make_shared<g2o::SparseOptimizerTerminateAction>();
    enough->setGainThreshold(1e-8);
    graph_.addPostIterationAction(enough);
    if (D == 3) {
      auto offset = std::make_shared<g2o::ParameterSE3Offset>();
      offset->setId(0);
      graph_.addParameter(offset);
    }
    for (int64_t k = 0; k < p.poses; ++k) {
      auto pose = std::make_shared<typename World::Pose>();
      pose->setId(static_cast<int>(k));
      pose->setEstimate(World::pose(p.T.data() + D * k, p.R.data() + D * D * k));
      pose->setFixed(k == 0);
      graph_.addVertex(pose);
      poses_.push_back(pose);
    }
    for (int64_t k = 0; k < p.landmarks; ++k) {
      auto point = std::make_shared<typename World::Point>();
      point->setId(static_cast<int>(p.poses + k));
      point->setEstimate(Eigen::Map<const Eigen::Matrix<double, D, 1>>(p.P.data() + D * k));
      graph_.addVertex(point);
      points_.push_back(point);
    }
    for (int64_t k = 0; k < p.steps; ++k) {
      auto step = std::make_shared<typename World::Step>();
      step->setVertex(0, poses_[p.step_from[k]]);
      step->setVertex(1, poses_[p.step_to[k]]);
      step->setMeasurement(World::pose(p.step_T.data() + D * k, p.step_R.data() + D * D * k));
      typename World::Step::InformationType information = World::Step::InformationType::Identity();
      information.template topLeftCorner<D, D>() /= p.sigma_T[k] * p.sigma_T[k];
      information.template bottomRightCorner<World::turns, World::turns>() *= World::turn_information(p.sigma_R[k]);
      step->setInformation(information);
      graph_.addEdge(step);
    }
    const typename World::Sighting::InformationType of_points =
        World::Sighting::InformationType::Identity() / (p.sigma_P * p.sigma_P);
    for (int64_t k = 0; k < p.sightings; ++k) {
      auto sighting = std::make_shared<typename World::Sighting>();
      sighting->setVertex(0, poses_[p.seen_from[k]]);
      sighting->setVertex(1, points_[p.seen[k]]);
      sighting->setMeasurement(Eigen::Map<const Eigen::Matrix<double, D, 1>>(p.z.data() + D * k));
      sighting->setInformation(of_points);
      if constexpr (D == 3) sighting->setParameterId(0, 0);
      graph_.addEdge(sighting);
    }
  }

  int solve() {
    graph_.initializeOptimization();
    return graph_.optimize(100);
  }

  Estimate read() const {
    Estimate out;
    for (const auto& pose : poses_) {
      const auto& x = pose->estimate();
      const auto R = World::rotation(x);
      for (int i = 0; i < D; ++i) out.T.push_back(x.translation()[i]);
      for (int i = 0; i < D; ++i)
        for (int j = 0; j < D; ++j) out.R.push_back(R(i, j));
    }
    for (const auto& point : points_)
      for (int i = 0; i < D; ++i) out.P.push_back(point->estimate()[i]);
    return out;
  }

  double marginals() {
    // Linearises at the estimate first, as the others do; the structure still stands.
    graph_.computeActiveErrors();
    algorithm_->updateLinearSystem();
    std::vector<std::pair<int, int>> wanted;
    for (const auto& point : points_) wanted.emplace_back(point->hessianIndex(), point->hessianIndex());
    g2o::SparseBlockMatrix<Eigen::MatrixXd> inverse;
    if (!graph_.computeMarginals(inverse, wanted)) return std::numeric_limits<double>::quiet_NaN();
    double trace = 0;
    for (const auto& [row, column] : wanted) trace += inverse.block(row, column)->trace();
    return trace;
  }

 private:
  const Problem& p_;
  g2o::SparseOptimizer graph_;
  std::shared_ptr<g2o::OptimizationAlgorithmWithHessian> algorithm_;
  std::vector<std::shared_ptr<typename World::Pose>> poses_;
  std::vector<std::shared_ptr<typename World::Point>> points_;
};

// Its headers do not say which version they are: this is written for the one in which graphs hold shared pointers.
constexpr const char* version = "2.3";

}  // namespace

int main(int argc, char** argv) {
  if (argc != 6) return measure<Model<Plane>>(argc, argv, version);
  return Problem(argv[1]).d == 2 ? measure<Model<Plane>>(argc, argv, version)
                                 : measure<Model<Space>>(argc, argv, version);
}
