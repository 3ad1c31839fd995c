#pragma once

#include <array>
#include <bit>
#include <cstdint>

#include "realtime/base/bytes/state_archive.hpp"
#include "recon/geometry/se3.hpp"

// 6 x 6 matrices as saved state, bit by bit, without their zeros and what is symmetric.
namespace fathom::slam {

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

}  // namespace fathom::slam
