#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "realtime/kernel/memory/arena.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/solver/block_kernels.hpp"
#include "recon/solver/pose_graph.hpp"

namespace fathom::slam {

// 6 x 6 matrices as saved state, bit by bit, without their zeros and what is symmetric.

// Writes a bit mask of the numbers that are not 0, column by column, then these. The root of an information
// is triangular, or empty but for some rows.
template <typename Archive, typename Matrix>
void exchangeSparse(Archive& archive, Matrix& matrix) {
  constexpr std::size_t kNumbers = 36;
  std::array<double, kNumbers> numbers;
  std::uint64_t present = 0;
  std::size_t count = 0;
  if constexpr (!Archive::kLoading) {
    for (std::size_t i = 0; i < kNumbers; ++i) {
      if (std::bit_cast<std::uint64_t>(matrix.data()[i]) == 0) continue;
      present |= std::uint64_t{1} << i;
      numbers[count++] = matrix.data()[i];
    }
  }
  archive(present);
  archive.require(present >> kNumbers == 0, "a matrix that is too large");
  if constexpr (Archive::kLoading) {
    if (!archive.ok()) return;
    count = static_cast<std::size_t>(std::popcount(present));
  }
  archive.elements(numbers.data(), count);
  if constexpr (Archive::kLoading) {
    const double* next = numbers.data();
    for (std::size_t i = 0; i < kNumbers; ++i) matrix.data()[i] = (present >> i & 1) != 0 ? *next++ : 0.0;
  }
}

// Writes the lower triangle, and the upper one where it differs (by rounding).
template <typename Archive, typename Matrix>
void exchangeSymmetric(Archive& archive, Matrix& matrix) {
  std::remove_const_t<Matrix> lower = matrix.template triangularView<Eigen::Lower>();
  std::remove_const_t<Matrix> upper = matrix.template triangularView<Eigen::StrictlyUpper>();
  exchangeSparse(archive, lower);
  bool symmetric = true;
  if constexpr (!Archive::kLoading)
    for (int column = 1; column < matrix.cols(); ++column)
      for (int row = 0; row < column; ++row)
        symmetric = symmetric && std::bit_cast<std::uint64_t>(matrix(row, column)) ==
                                     std::bit_cast<std::uint64_t>(matrix(column, row));
  archive(symmetric);
  if (!symmetric) exchangeSparse(archive, upper);
  if constexpr (Archive::kLoading) {
    if (symmetric) upper = lower.transpose().template triangularView<Eigen::StrictlyUpper>();
    for (int column = 0; column < matrix.cols(); ++column)
      for (int row = 0; row < matrix.rows(); ++row)
        matrix(row, column) = row < column ? upper(row, column) : lower(row, column);
  }
}

inline constexpr int kWorld = -1;  // `from` of a measurement of a pose itself

// A relative pose as measured, with a square root of its information; kWorld is the origin of the world.
struct Measurement {
  int from = kWorld, to = 0;
  int next[2] = {-1, -1};  // further measurement of `from` and of `to`; see Measurements::next
  SE3 T_from_to;
  Matrix6d root;      // root^T root = information
  double weight = 1;  // of chi2; 0: taken out
  double lever = 1;   // length over which a turn counts as much as a shift [m]
  bool in_use = false;
  bool composed = false;  // from others, when the pose between them was retired
  std::int64_t born = 0;  // number of measurements that came before it
};

// Poses are solved for by perturbations (v, w) in the world: T <- (exp(w), v) T. A motion of a whole group of
// poses is then the same perturbation for all of them and changes no error inside the group, at any size of
// the step, also by derivatives that were taken at other poses. (With perturbations in each pose's own frame
// this fails: a factor that is slightly old is then useless along the long, soft valleys of a graph.) An
// error depends on the difference of its poses' perturbations:
//   d error = B (x_to - x_from),   B = by_to A(T_w_to),   A x = (R^T (v + w x t), R^T w)
using PosePerturbation = Vector6d;
[[nodiscard]] Vector6d toOwnFrame(const SE3& T_w_pose, const PosePerturbation& x);        // A x
[[nodiscard]] PosePerturbation fromOwnFrame(const SE3& T_w_pose, const Vector6d& force);  // A^T f
[[nodiscard]] Matrix6d ownFrame(const SE3& T_w_pose);                                     // A
[[nodiscard]] SE3 perturbedInWorld(const SE3& T_w_pose, const PosePerturbation& x);

// Error of a measurement and its derivative by the perturbation of `to`
// in its own frame, times the root of information and weight.
struct WhitenedLinear {
  Matrix6d by_to;
  Vector6d error;
};

enum class AddStatus { kOk, kFull, kNoSuchPose, kBadMeasurement };

// Measurements of a graph in fixed memory, and for each pose a list of those that have it as an end.
class Measurements {
 public:
  Measurements(int poses, int capacity, rt::Arena& arena);
  static std::size_t bytes(int poses, int capacity);

  // kBadMeasurement: not finite, from a pose to itself, or an information matrix that is not symmetric and
  // positive semidefinite. kNoSuchPose: an end is not among the first `poses`. `index`, if given,
  // receives its place: a new one, or one that a removed measurement left.
  AddStatus add(const RelativePose& edge, int poses, int* index = nullptr, bool composed = false);
  void remove(int k);
  // Place of the next one.
  int nextPlace() const { return free_count_ > 0 ? free_[static_cast<std::size_t>(free_count_ - 1)] : size_; }
  int size() const { return size_; }                 // places used so far: indices are below
  int count() const { return size_ - free_count_; }  // in use
  std::int64_t births() const { return births_; }    // ever added
  const Measurement& operator[](int k) const { return all_[static_cast<std::size_t>(k)]; }
  void setWeight(int k, double weight) { all_[static_cast<std::size_t>(k)].weight = weight; }

  // Measurements of a pose, newest first: for (k = first(pose); k >= 0; k = next(k, pose)).
  int first(int pose) const { return first_[static_cast<std::size_t>(pose)]; }
  int next(int k, int pose) const { return (*this)[k].next[(*this)[k].to == pose ? 1 : 0]; }

  // `poses`: as many as there are.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader, int poses);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  void link(int k);
  void unlink(int pose, int k);

  std::span<Measurement> all_;
  std::span<int> first_;
  std::span<int> free_;
  int size_ = 0, free_count_ = 0;
  std::int64_t births_ = 0;
};

// The plain error.
Vector6d plainError(const Measurement& m, const SE3& T_w_from, const SE3& T_w_to);
// Square root of the information of a measurement's right perturbation. (The plain error has half angles.)
Matrix6d rootByPerturbation(const Measurement& m);
// Returns the plain error. Both depend on the relative pose alone.
Vector6d linearizeWhitened(const Measurement& m, const SE3& T_from_to, double weight, WhitenedLinear& result);

[[nodiscard]] inline bool isFinite(const SE3& T) {
  return T.translation().allFinite() && T.rotation().coeffs().allFinite();
}

// For saved state: each of `indices` is below `size`, occurs once, and is free(index).
[[nodiscard]] bool areFreePlaces(std::span<const int> indices, int size, const auto& free) {
  std::vector<bool> met(static_cast<std::size_t>(size));
  for (const int i : indices) {
    if (i < 0 || i >= size || met[static_cast<std::size_t>(i)] || !free(i)) return false;
    met[static_cast<std::size_t>(i)] = true;
  }
  return true;
}

// The linearisation of a measurement that a factor holds.
struct InFactor {
  SE3 T_w_from, T_w_to;  // poses where it was linearised
  double weight = 0;
};
// The B above, at the poses and weight in `then`.
Block worldDerivative(const Measurement& m, const InFactor& then);

}  // namespace fathom::slam
