// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>

#include "localizer/filter/paired_lower_triangle.h"
#include "mapstore/map/joint_covariance.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// What a filter that considers the errors of map and sensor leaves in its innovations.
///
/// A Schmidt-Kalman filter estimates neither the errors of the modes nor the sensor's bias, so its
/// innovations are not white: the product of their densities would count an error that all of them
/// share once for each of them, and a landmark some decimetres off its place in the map would prove
/// itself at another mode within seconds. Here those errors *are* estimated, together with the
/// error of the filter's state. The likelihood of observations uses them, and the pose does beside
/// landmarks that moved. It is the Kalman filter of a = (state error, bias, error of each mode in
/// use), linearized where the Schmidt filter is.
///
/// Without heap allocations: at most kMaxModes modes, of which the one unused for longest goes.
class SharedErrors {
 public:
  static constexpr int kStates = 6;      ///< As those of KnownMapFilter.
  static constexpr int kRangeScale = 5;  ///< Row of the state: log range scale.
  static constexpr int kMaxModes = 12;
  static constexpr int kMaxRows = kStates + 2 + 2 * kMaxModes;
  using StateMatrix = Eigen::Matrix<double, kStates, kStates>;
  using StateVector = Eigen::Matrix<double, kStates, 1>;

  explicit SharedErrors(const StateMatrix& cov_state);

  /// As the state of the filter: its error becomes F times what it was, plus noise. The bias drifts
  /// within its distribution.
  /// @param F  [F_pose F_scale; 0 I]: motion changes the pose's error.
  void Predict(const StateMatrix& F, const StateMatrix& noise, double elapsed_s);

  /// The filter's state was corrected, and its error is A (what it was - correction).
  /// @param A  [A_pose 0; 0 I].
  void Move(const StateMatrix& A, const StateVector& correction);

  /// For Observed::mode_index: the unknown place of a group, of which nothing is known before it is
  /// seen. Its error is that of the fixed point which the innovations are taken against.
  static int PlaceIndex(int group) { return -1 - group; }

  /// An innovation ν = H_pose x̃_pose + H_range_scale x̃_scale + H_bias b + H_mode e + v of a mode, v
  /// ~ N(0, cov_noise).
  struct Observed {
    int mode_index = 0;  ///< Row in the map's covariance; or PlaceIndex().
    Observation::Kind kind = Observation::Kind::kRangeBearing;
    Eigen::Vector2d nu = Eigen::Vector2d::Zero();
    Eigen::Matrix<double, 2, 3> H_pose = Eigen::Matrix<double, 2, 3>::Zero();
    Eigen::Vector2d H_range_scale = Eigen::Vector2d::Zero();
    Eigen::Matrix2d H_bias = Eigen::Matrix2d::Zero();
    Eigen::Matrix2d H_mode = Eigen::Matrix2d::Zero();
    Eigen::Matrix2d cov_bias = Eigen::Matrix2d::Zero();  ///< Prior of b.
    Eigen::Matrix2d cov_noise = Eigen::Matrix2d::Zero();

    /// What is known of b, if it is not in use: its regression on the state's error, and the rest.
    Eigen::Matrix<double, 2, kStates> bias_on_state = Eigen::Matrix<double, 2, kStates>::Zero();
    std::optional<Eigen::Matrix2d> cov_bias_rest;  ///< By default cov_bias.
  };

  /// Something of a mode or place has been taken in and counts.
  bool Has(int mode_index) const { return Row(mode_index) >= 0; }

  void Forget(int mode_index);

  /// Whether the bias in use is of this kind of observation.
  bool HasBias(Observation::Kind kind) const { return has_bias_ && kind_ == kind; }

  /// What is known of a mode that was in use before: its error is the regression on a, by rows, and
  /// a rest that nothing else shares.
  struct Regression {
    Eigen::Matrix<double, 2, Eigen::Dynamic, 0, 2, kMaxRows> on;
    Eigen::Matrix2d cov_rest = Eigen::Matrix2d::Zero();
  };

  /// Takes it in. Precondition: MakeRoom() was called before the regression was made.
  void Add(int mode_index, const Regression& regression);
  void MakeRoom();

  /// Of the bias of `observed`, if another kind is in use or none.
  void UseBiasOf(const Observed& observed);

  /// Rows of a: those of the state begin with 0, of the bias with kBiasRow, of a mode or place in
  /// use with Row(), -1 of others.
  static constexpr int kBiasRow = kStates;
  int Row(int mode_index) const;
  int rows() const { return kFixed + 2 * modes_; }

  /// log p(ν | everything taken in before); not finite if numbers have lost their digits.
  double LogLikelihood(const Observed& observed, const JointCovariance& covariance) const;

  /// Takes an observation in; false if numbers have lost their digits: to be made anew.
  [[nodiscard]] bool Update(const Observed& observed, const JointCovariance& covariance);

  using StateByPoint = Eigen::Matrix<double, kStates, 2>;

  /// The filter's error given all that was taken in, linearized where the filter is.
  StateVector MeanOfState() const { return mean_.head<kStates>(); }
  StateMatrix CovarianceOfState() const;

  /// Of the state's error with the bias in use.
  StateByPoint CrossOfBias() const;

  /// Modes and places that something was taken in of.
  std::span<const int> in_use() const {
    return {mode_indices_.data(), static_cast<std::size_t>(modes_)};
  }

  /// The error of a mode or place in use given all that was taken in.
  struct PointError {
    Eigen::Vector2d mean = Eigen::Vector2d::Zero();
    Eigen::Matrix2d cov = Eigen::Matrix2d::Zero();
    StateByPoint cross_state = StateByPoint::Zero();       ///< Of the state's error with it.
    Eigen::Matrix2d cross_bias = Eigen::Matrix2d::Zero();  ///< Of the bias with it.
  };
  PointError ErrorOf(int mode_index) const;

 private:
  // Of a: bias and each mode begin with an even row.
  static constexpr int kBias = kStates;
  static constexpr int kFixed = kStates + 2;
  static_assert(kStates % 2 == 0);
  using Vector = Eigen::Matrix<double, kMaxRows, 1>;
  using Columns = Eigen::Matrix<double, kMaxRows, 2>;

  // The error of a mode given all that was seen.
  struct ModeError {
    Eigen::Vector2d mean;
    Eigen::Matrix2d cov;
    Columns cross;  // Of a with it.
  };
  struct Expected {
    Eigen::Vector2d nu;
    Eigen::Matrix2d S;
    Columns cross;  // Of a with the innovation.
  };

  // Of `rows` rows of a, even and at least kFixed; what others would be is left open.
  ModeError ErrorOf(int mode_index, const JointCovariance& covariance, int rows) const;
  ModeError ErrorOfNew(int mode_index, const JointCovariance& covariance) const;
  Expected Expect(const Observed& observed, const ModeError& mode, int rows) const;

  // x̃_pose <- B x̃ for the first columns of x̃.
  template <int kColumns>
  void TransformPose(const Eigen::Matrix<double, 3, kColumns>& B);
  void Subtract(const Columns& K, const Columns& cross);  // K crossᵀ, from the covariance.
  void Add(int mode_index, const ModeError& mode);
  void RemoveOldest();
  void Remove(std::size_t slot);

  int modes_ = 0;
  std::array<int, kMaxModes> mode_indices_{};
  std::array<int, kMaxModes> last_used_{};
  int uses_ = 0;
  bool has_bias_ = false;
  Observation::Kind kind_ = Observation::Kind::kRangeBearing;
  Eigen::Matrix2d cov_bias_ = Eigen::Matrix2d::Zero();
  Vector mean_ = Vector::Zero();
  PairedLowerTriangle<kMaxRows, kFixed> cov_;
};

}  // namespace shiftmap
