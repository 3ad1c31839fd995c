#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>

#include "realtime/base/bytes/state_archive.hpp"

// Saved state (state_archive.hpp) of Eigen's matrices of fixed size and quaternions: their numbers in a row.
// In Eigen's namespace, for argument-dependent lookup.
namespace Eigen {

template <typename Archive, typename Scalar, int Rows, int Columns, int Options>
requires(Rows != Dynamic &&
         Columns != Dynamic) void exchangeState(Archive& archive,
                                                const Matrix<Scalar, Rows, Columns, Options>& value) {
  archive.bytes(value.data(), sizeof(Scalar) * Rows * Columns);
}
template <typename Archive, typename Scalar, int Rows, int Columns, int Options>
requires(Rows != Dynamic &&
         Columns != Dynamic) void exchangeState(Archive& archive,
                                                Matrix<Scalar, Rows, Columns, Options>& value) {
  archive.bytes(value.data(), sizeof(Scalar) * Rows * Columns);
}
template <typename Archive, typename Scalar>
void exchangeState(Archive& archive, const Quaternion<Scalar>& value) {
  archive(value.coeffs());
}
template <typename Archive, typename Scalar>
void exchangeState(Archive& archive, Quaternion<Scalar>& value) {
  archive(value.coeffs());
}

}  // namespace Eigen
