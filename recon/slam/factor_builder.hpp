#pragma once

#include <cstdint>
#include <span>

#include "recon/slam/growing_factor.hpp"
#include "recon/slam/measurements.hpp"

namespace fathom::slam {

// Builds the factor of a graph's normal equations from nothing, a slice at a time: approximate minimum degree
// with the newest poses kept for the end (CAMD; Chen, Davis, Hager & Rajamanickam 2008), where loop closures
// to come will mostly join, then column after column by left-looking Cholesky. Poses and measurements are
// copied at the start, so that all slices see one linear system.
class FactorBuilder {
 public:
  struct Size {
    int poses = 0;
    int measurements = 0;
  };
  FactorBuilder(const Size& size, rt::Arena& arena);
  static std::size_t bytes(const Size& size);

  // Takes the given poses and all measurements so far but those that are `left_out`; the order keeps for the
  // end poses that are `newest`. When blocks() are more than the factor has room for, nothing more can be
  // done. Diagonal blocks are multiplied by 1 + `damping` (Marquardt 1963; by whole blocks, because a
  // diagonal alone depends on where the world's origin is). Returns the work of ordering.
  std::int64_t begin(std::span<const SE3> poses, std::span<const std::uint8_t> held,
                     std::span<const std::uint8_t> newest, std::span<const std::uint8_t> left_out,
                     const Measurements& measurements, double damping, GrowingFactor& factor);
  // Of the factor below its diagonal, counted before it is begun.
  [[nodiscard]] std::int64_t blocks() const { return blocks_; }
  // Goes on until `quota` is used up or all columns are done; returns the work done. Notes for each
  // measurement where it was linearised.
  std::int64_t run(std::int64_t quota, GrowingFactor& factor, std::span<InFactor> in_factor);

  double weightOf(int measurement) const { return measurements_[measurement].weight; }  // that it takes
  bool running() const { return next_ < poses_; }

 private:
  static std::size_t at(std::int64_t i) { return static_cast<std::size_t>(i); }
  void order(std::span<const std::uint8_t> newest);
  void count();
  bool counts(int k) const;
  std::int64_t column(int j, GrowingFactor& factor, std::span<InFactor> then);

  const ColumnKernels* kernels_ = &fastestColumnKernels();
  std::span<SE3> at_poses_;
  Measurements measurements_;
  std::span<std::uint8_t> held_;
  std::span<int> order_;
  std::span<int> ordering_;              // CAMD's memory
  std::span<int> head_, link_, cursor_;  // columns whose next row is here; chain; that row's place
  std::span<int> first_child_, next_sibling_;
  std::span<int> place_;  // by position: block in the current column, or -1
  std::span<int> pattern_;
  int poses_ = 0, next_ = 0;
  std::int64_t blocks_ = 0;
  double damping_ = 0;
};

}  // namespace fathom::slam
