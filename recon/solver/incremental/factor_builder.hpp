#pragma once

#include <cstdint>
#include <span>

#include "recon/solver/incremental/growing_factor.hpp"
#include "recon/solver/measurements.hpp"

namespace fathom::slam {

// Builds the factor of a graph's normal equations from nothing, a slice at a time: approximate minimum degree
// with the newest poses kept for the end (CAMD; Chen, Davis, Hager & Rajamanickam 2008), where loop closures
// to come will mostly join, then column after column by left-looking Cholesky. All slices see one linear
// system, that of the start: poses, and the measurements' indices and weights, are copied; a measurement
// itself is read in its place, and is kept here by keep() before that place is reused.
class FactorBuilder {
 public:
  struct Size {
    int poses = 0;
    int measurements = 0;
    int kept = 0;  // measurements with a place that is reused while one factor is built
  };
  FactorBuilder(const Size& size, rt::Arena& arena);
  static std::size_t bytes(const Size& size);

  // Takes the given poses and all measurements so far but those that are `left_out`; the order keeps for the
  // end poses that are `newest`. When blocks() are more than the factor has room for, nothing more can be
  // done. Diagonal blocks are multiplied by 1 + `damping` (Marquardt 1963; by whole blocks, because a
  // diagonal alone depends on where the world's origin is). Returns the work of ordering.
  // `measurements` must stay where it is while running().
  std::int64_t begin(std::span<const SE3> poses, std::span<const std::uint8_t> held,
                     std::span<const std::uint8_t> newest, std::span<const std::uint8_t> left_out,
                     const Measurements& measurements, double damping, GrowingFactor& factor);
  // Of the factor below its diagonal, counted before it is begun.
  [[nodiscard]] std::int64_t blocks() const { return blocks_; }
  // Continues until `quota` is used up or all columns are done; returns the work done. Notes for each
  // measurement where it was linearised.
  std::int64_t run(std::int64_t quota, GrowingFactor& factor, std::span<InFactor> in_factor);

  // Before a measurement's place is reused: keeps the measurement if it is still to be read. False when there
  // is no room for that; then the factor cannot be finished.
  [[nodiscard]] bool keep(int measurement);

  double weightOf(int measurement) const { return links_[at(measurement)].weight; }  // that it takes
  bool running() const { return next_ < poses_; }

 private:
  // A measurement as it was at the start, and the next ones in its poses' lists.
  struct Link {
    int from = kWorld, to = 0;
    int next[2] = {-1, -1};
    double weight = 0;
    int kept = -1;  // in kept_
  };
  int first(int pose) const { return first_[at(pose)]; }
  int next(int k, int pose) const { return links_[at(k)].next[links_[at(k)].to == pose ? 1 : 0]; }
  const Measurement& measurement(int k) const {
    const int kept = links_[at(k)].kept;
    return kept >= 0 ? kept_[at(kept)] : (*measurements_)[k];
  }
  void order(std::span<const std::uint8_t> newest);
  void count();
  bool counts(int k) const;
  int otherEnd(int k, int pose) const {
    return links_[at(k)].from == pose ? links_[at(k)].to : links_[at(k)].from;
  }
  int findRows(int j, GrowingFactor& factor);
  std::int64_t addMeasurements(int j, GrowingFactor& factor, std::span<InFactor> then);
  std::int64_t subtractColumns(int j, GrowingFactor& factor);
  std::int64_t column(int j, GrowingFactor& factor, std::span<InFactor> then);

  const ColumnKernels* kernels_ = &fastestColumnKernels();
  std::span<SE3> at_poses_;
  const Measurements* measurements_ = nullptr;
  std::span<Link> links_;
  std::span<int> first_;  // of a pose
  std::span<Measurement> kept_;
  std::span<std::uint8_t> fixed_;
  std::span<int> order_;
  std::span<int> ordering_;  // CAMD's memory
  std::span<int> head_, link_,
      cursor_;  // first column with its next row here; next such column; that row's place
  std::span<int> first_child_, next_sibling_;
  std::span<int> place_;  // by position: block in the current column, or -1
  std::span<int> pattern_;
  int poses_ = 0, next_ = 0, links_count_ = 0, kept_count_ = 0;
  std::int64_t blocks_ = 0;
  double damping_ = 0;
};

}  // namespace fathom::slam
