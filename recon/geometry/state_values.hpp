#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "realtime/base/bytes/state_archive.hpp"

// Saved state (state_archive.hpp) of Eigen's matrices of fixed size and quaternions: their numbers in a row.
// In Eigen's namespace, for argument-dependent lookup.
namespace Eigen {

template <typename T>
concept MatrixOfFixedSize = T::SizeAtCompileTime >
0;
template <typename T>
concept QuaternionOfNumbers = requires(T& value) {
  value.coeffs();
};

void exchangeState(auto& archive, MatrixOfFixedSize auto& value) {
  archive.bytes(value.data(), sizeof(*value.data()) * static_cast<std::size_t>(value.size()));
}
void exchangeState(auto& archive, QuaternionOfNumbers auto& value) {
  archive(value.coeffs());
}

}  // namespace Eigen
