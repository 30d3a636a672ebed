// Ceres with analytic Jacobians in the tangent space. Variants: amd (its own default), metis (nested dissection of the
// block graph by CHOLMOD's METIS, handed over as an elimination order: this Ceres has no option for it), careful (metis,
// with its own trust region instead of Gauss-Newton steps).
#include <ceres/ceres.h>
#include <cholmod.h>

#include <Eigen/Dense>
#include <array>
#include <memory>

#include "native.hpp"

namespace {

template <int D>
constexpr int angles = D == 2 ? 1 : 3;
template <int D>
constexpr int numbers = D == 2 ? 3 : 7;  // x y heading, or x y z and a quaternion x y z w
template <int D>
constexpr int freedom = D == 2 ? 3 : 6;

template <int D>
using Vector = Eigen::Matrix<double, D, 1>;
template <int D>
using Square = Eigen::Matrix<double, D, D>;
template <int R, int C>
using Jacobian = Eigen::Matrix<double, R, C, C == 1 ? Eigen::ColMajor : Eigen::RowMajor>;

template <int D>
Square<D> rotation_of(const double* pose) {
  if constexpr (D == 2)
    return Eigen::Rotation2Dd(pose[2]).toRotationMatrix();
  else
    return Eigen::Map<const Eigen::Quaterniond>(pose + 3).toRotationMatrix();
}

// Poses move by T + dT, R Exp(w). Costs write their derivatives in the tangent into the first six of seven columns, which
// this manifold passes on: the cheapest way through Ceres.
class TangentManifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* out) const override {
    for (int i = 0; i < 3; ++i) out[i] = x[i] + delta[i];
    const Eigen::Map<const Eigen::Vector3d> w(delta + 3);
    const double angle = w.norm(), scale = angle > 1e-12 ? std::sin(0.5 * angle) / angle : 0.5;
    const Eigen::Quaterniond turn(std::cos(0.5 * angle), scale * w[0], scale * w[1], scale * w[2]);
    Eigen::Map<Eigen::Quaterniond>(out + 3) = (Eigen::Map<const Eigen::Quaterniond>(x + 3) * turn).normalized();
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>>(jacobian).setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* out) const override {
    for (int i = 0; i < 3; ++i) out[i] = y[i] - x[i];
    const Eigen::AngleAxisd turn(Eigen::Map<const Eigen::Quaterniond>(x + 3).conjugate() *
                                 Eigen::Map<const Eigen::Quaterniond>(y + 3));
    Eigen::Map<Eigen::Vector3d>(out + 3) = turn.angle() * turn.axis();
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>>(jacobian).setIdentity();
    return true;
  }
};

Eigen::Matrix3d hat(const Eigen::Vector3d& w) {
  Eigen::Matrix3d m;
  m << 0, -w[2], w[1], w[2], 0, -w[0], -w[1], w[0], 0;
  return m;
}

// [zT - R1'(T2 - T1); Log((R1'R2)' zR)] over the sigmas.
template <int D>
class Step final : public ceres::SizedCostFunction<freedom<D>, numbers<D>, numbers<D>> {
 public:
  Step(const double* T, const double* R, double sigma_T, double sigma_R) : w_T_(1 / sigma_T), w_R_(1 / sigma_R) {
    T_ = Eigen::Map<const Vector<D>>(T);
    R_ = Eigen::Map<const Eigen::Matrix<double, D, D, Eigen::RowMajor>>(R);
  }
  bool Evaluate(double const* const* x, double* e, double** J) const override {
    const Square<D> R1 = rotation_of<D>(x[0]);
    const Vector<D> h = R1.transpose() * (Eigen::Map<const Vector<D>>(x[1]) - Eigen::Map<const Vector<D>>(x[0]));
    Eigen::Map<Vector<D>> of_T(e);
    of_T = w_T_ * (T_ - h);
    if constexpr (D == 2) {
      const double angle = std::atan2(R_(1, 0), R_(0, 0)) - (x[1][2] - x[0][2]);
      e[2] = w_R_ * std::remainder(angle, 2 * M_PI);
      if (!J) return true;
      if (J[0]) {
        Eigen::Map<Jacobian<3, 3>> A(J[0]);
        A.setZero();
        A.template topLeftCorner<2, 2>() = w_T_ * R1.transpose();
        A(0, 2) = -w_T_ * h[1], A(1, 2) = w_T_ * h[0];
        A(2, 2) = w_R_;
      }
      if (J[1]) {
        Eigen::Map<Jacobian<3, 3>> A(J[1]);
        A.setZero();
        A.template topLeftCorner<2, 2>() = -w_T_ * R1.transpose();
        A(2, 2) = -w_R_;
      }
    } else {
      const Square<3> R2 = rotation_of<3>(x[1]);
      const Square<3> difference = R2.transpose() * R1 * R_;
      const Eigen::AngleAxisd turn(difference);
      const Eigen::Vector3d w = turn.angle() * turn.axis();
      Eigen::Map<Eigen::Vector3d>(e + 3) = w_R_ * w;
      if (!J) return true;
      // d Log(Exp(-a) M) = -Jr^-1(w) M' a, d Log(M Exp(b)) = Jr^-1(w) b with M = R2'R1 zR.
      const double t = w.norm();
      const double c = t > 1e-4 ? 1 / (t * t) - (1 + std::cos(t)) / (2 * t * std::sin(t)) : 1.0 / 12;
      const Eigen::Matrix3d W = hat(w), inverse = Eigen::Matrix3d::Identity() + 0.5 * W + c * W * W;
      if (J[0]) {
        Eigen::Map<Jacobian<6, 7>> A(J[0]);
        A.setZero();
        A.template topLeftCorner<3, 3>() = w_T_ * R1.transpose();
        A.template block<3, 3>(0, 3) = -w_T_ * hat(h);
        A.template block<3, 3>(3, 3) = w_R_ * inverse * R_.transpose();
      }
      if (J[1]) {
        Eigen::Map<Jacobian<6, 7>> A(J[1]);
        A.setZero();
        A.template topLeftCorner<3, 3>() = -w_T_ * R1.transpose();
        A.template block<3, 3>(3, 3) = -w_R_ * inverse * difference.transpose();
      }
    }
    return true;
  }

 private:
  Vector<D> T_;
  Square<D> R_;
  double w_T_, w_R_;
};

// (z - R'(p - T)) over sigma.
template <int D>
class Sighting final : public ceres::SizedCostFunction<D, numbers<D>, D> {
 public:
  Sighting(const double* z, double sigma) : w_(1 / sigma) { z_ = Eigen::Map<const Vector<D>>(z); }
  bool Evaluate(double const* const* x, double* e, double** J) const override {
    const Square<D> R = rotation_of<D>(x[0]);
    const Vector<D> h = R.transpose() * (Eigen::Map<const Vector<D>>(x[1]) - Eigen::Map<const Vector<D>>(x[0]));
    Eigen::Map<Vector<D>> residual(e);
    residual = w_ * (z_ - h);
    if (!J) return true;
    if (J[0]) {
      Eigen::Map<Jacobian<D, numbers<D>>> A(J[0]);
      A.setZero();
      A.template topLeftCorner<D, D>() = w_ * R.transpose();
      if constexpr (D == 2)
        A(0, 2) = -w_ * h[1], A(1, 2) = w_ * h[0];
      else
        A.template block<3, 3>(0, 3) = -w_ * hat(h);
    }
    if (J[1]) {
      Eigen::Map<Jacobian<D, D>> A(J[1]);
      A = -w_ * R.transpose();
    }
    return true;
  }

 private:
  Vector<D> z_;
  double w_;
};

// Places in a nested dissection order of the graph of poses and landmarks.
std::vector<int> dissect(const Problem& p) {
  const int64_t n = p.poses + p.landmarks;
  cholmod_common common;
  cholmod_start(&common);
  common.nmethods = 1;
  common.method[0].ordering = CHOLMOD_METIS;
  common.supernodal = CHOLMOD_SIMPLICIAL;
  cholmod_triplet* triplet = cholmod_allocate_triplet(n, n, n + p.steps + p.sightings, -1, CHOLMOD_REAL, &common);
  const auto add = [&](int64_t i, int64_t j) {
    static_cast<int*>(triplet->i)[triplet->nnz] = static_cast<int>(std::max(i, j));
    static_cast<int*>(triplet->j)[triplet->nnz] = static_cast<int>(std::min(i, j));
    static_cast<double*>(triplet->x)[triplet->nnz++] = 1.0;
  };
  for (int64_t i = 0; i < n; ++i) add(i, i);
  for (int64_t k = 0; k < p.steps; ++k) add(p.step_from[k], p.step_to[k]);
  for (int64_t k = 0; k < p.sightings; ++k) add(p.seen_from[k], p.poses + p.seen[k]);
  cholmod_sparse* graph = cholmod_triplet_to_sparse(triplet, 0, &common);
  cholmod_factor* factor = cholmod_analyze(graph, &common);
  std::vector<int> place(n);
  for (int64_t i = 0; i < n; ++i) place[static_cast<int*>(factor->Perm)[i]] = static_cast<int>(i);
  cholmod_free_factor(&factor, &common), cholmod_free_sparse(&graph, &common);
  cholmod_free_triplet(&triplet, &common), cholmod_finish(&common);
  return place;
}

template <int D>
class Model {
 public:
  Model(const Problem& p, const std::string& variant) : p_(p), variant_(variant), poses_(p.poses), points_(p.P) {
    ceres::Problem::Options options;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.disable_all_safety_checks = true;
    problem_ = std::make_unique<ceres::Problem>(options);
    for (int64_t k = 0; k < p.poses; ++k) {
      double* pose = poses_[k].data();
      std::copy_n(p.T.data() + D * k, D, pose);
      if constexpr (D == 2) {
        pose[2] = std::atan2(p.R[4 * k + 2], p.R[4 * k]);
        problem_->AddParameterBlock(pose, 3);
      } else {
        const Eigen::Matrix3d R = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(p.R.data() + 9 * k);
        Eigen::Map<Eigen::Quaterniond>(pose + 3) = Eigen::Quaterniond(R).normalized();
        problem_->AddParameterBlock(pose, 7, &manifold_);
      }
    }
    for (int64_t k = 0; k < p.landmarks; ++k) problem_->AddParameterBlock(points_.data() + D * k, D);
    for (int64_t k = 0; k < p.steps; ++k) {
      problem_->AddResidualBlock(
          new Step<D>(p.step_T.data() + D * k, p.step_R.data() + D * D * k, p.sigma_T[k], p.sigma_R[k]), nullptr,
          poses_[p.step_from[k]].data(), poses_[p.step_to[k]].data());
    }
    for (int64_t k = 0; k < p.sightings; ++k)
      problem_->AddResidualBlock(new Sighting<D>(p.z.data() + D * k, p.sigma_P), nullptr,
                                 poses_[p.seen_from[k]].data(), points_.data() + D * p.seen[k]);
    problem_->SetParameterBlockConstant(poses_[0].data());
  }

  int solve() {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
    options.num_threads = 2;
    options.max_num_iterations = 100;
    options.function_tolerance = 1e-8;
    options.gradient_tolerance = 0.0;
    options.parameter_tolerance = 0.0;
    if (variant_ != "careful") {  // Gauss-Newton steps
      options.initial_trust_region_radius = 1e16;
      options.max_trust_region_radius = 1e20;
    }
    options.logging_type = ceres::SILENT;
    if (variant_ != "amd") {
      const std::vector<int> place = dissect(p_);
      options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
      for (int64_t k = 0; k < p_.poses; ++k)
        options.linear_solver_ordering->AddElementToGroup(poses_[k].data(), place[k]);
      for (int64_t k = 0; k < p_.landmarks; ++k)
        options.linear_solver_ordering->AddElementToGroup(points_.data() + D * k, place[p_.poses + k]);
    }
    ceres::Solver::Summary summary;
    ceres::Solve(options, problem_.get(), &summary);
    if (std::getenv("BENCHMARK_VERBOSE")) std::cerr << summary.FullReport() << "\n";
    return static_cast<int>(summary.iterations.size()) - 1;
  }

  Estimate read() const {
    Estimate out;
    out.P = points_;
    for (const auto& pose : poses_) {
      out.T.insert(out.T.end(), pose.begin(), pose.begin() + D);
      const Square<D> R = rotation_of<D>(pose.data());
      for (int i = 0; i < D; ++i)
        for (int j = 0; j < D; ++j) out.R.push_back(R(i, j));
    }
    return out;
  }

  double marginals() {
    ceres::Covariance::Options options;
    options.algorithm_type = ceres::SPARSE_QR;
    options.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
    options.num_threads = 2;
    ceres::Covariance covariance(options);
    std::vector<std::pair<const double*, const double*>> blocks;
    for (int64_t k = 0; k < p_.landmarks; ++k)
      blocks.emplace_back(points_.data() + D * k, points_.data() + D * k);
    covariance.Compute(blocks, problem_.get());
    double trace = 0.0;
    for (const auto& [point, same] : blocks) {
      Square<D> block;
      covariance.GetCovarianceBlock(point, same, block.data());
      trace += block.trace();
    }
    return trace;
  }

 private:
  const Problem& p_;
  std::string variant_;
  std::vector<std::array<double, numbers<D>>> poses_;
  std::vector<double> points_;
  TangentManifold manifold_;
  std::unique_ptr<ceres::Problem> problem_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 6) return measure<Model<2>>(argc, argv, CERES_VERSION_STRING);
  return Problem(argv[1]).d == 2 ? measure<Model<2>>(argc, argv, CERES_VERSION_STRING)
                                 : measure<Model<3>>(argc, argv, CERES_VERSION_STRING);
}
