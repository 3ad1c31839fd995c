#pragma once

#include <new>
#include <span>
#include <type_traits>

#include "realtime/kernel/arena.hpp"

namespace fathom::slam {

// Arena::allocateArray for Eigen's types too, whose constructors do not say that they never throw. Empty when
// the objects do not fit.
template <typename T>
[[nodiscard]] std::span<T> arenaArray(rt::Arena& arena, std::size_t count) {
  static_assert(std::is_trivially_destructible_v<T>);
  void* memory = arena.allocate(count * sizeof(T), alignof(T));
  if (memory == nullptr) return {};
  T* first = static_cast<T*>(memory);
  for (std::size_t i = 0; i < count; ++i) ::new (static_cast<void*>(first + i)) T();
  return {first, count};
}

}  // namespace fathom::slam
