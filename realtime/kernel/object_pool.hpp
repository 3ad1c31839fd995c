#pragma once

#include <cassert>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <utility>

#include "realtime/kernel/arena.hpp"

namespace fathom::rt {

// A fixed number of objects of one type over an arena's memory; acquire and release in constant time, in any
// order. For one thread at a time. When every object is out, acquire() returns nullptr and counts the
// refusal: what is then given up (the oldest frame, the least valuable area) is the owner's decision.
template <typename T>
class ObjectPool {
 public:
  // Takes its memory from `arena`, which must outlive the pool. Throws std::bad_alloc when it does not fit
  // (set-up).
  ObjectPool(Arena& arena, std::uint32_t capacity) : capacity_(capacity), available_(capacity) {
    slots_ = static_cast<Slot*>(arena.allocate(sizeof(Slot) * capacity, alignof(Slot)));
    const auto free_indices = arena.allocateArray<std::uint32_t>(capacity);
    const auto in_use = arena.allocateArray<bool>(capacity);
    if (slots_ == nullptr || free_indices.size() != capacity || in_use.size() != capacity)
      throw std::bad_alloc();
    free_indices_ = free_indices.data();
    in_use_ = in_use.data();
    // The lowest slot is handed out first.
    for (std::uint32_t i = 0; i < capacity; ++i) free_indices_[i] = capacity - 1 - i;
  }
  ~ObjectPool() {
    for (std::uint32_t i = 0; i < capacity_; ++i)
      if (in_use_[i]) std::destroy_at(object(i));
  }
  ObjectPool(const ObjectPool&) = delete;
  ObjectPool& operator=(const ObjectPool&) = delete;

  // An object constructed from `arguments`, or nullptr when none is free.
  template <typename... Arguments>
  [[nodiscard]] T* acquire(Arguments&&... arguments) {
    if (available_ == 0) {
      ++refused_;
      return nullptr;
    }
    const std::uint32_t index = free_indices_[available_ - 1];
    T* made = ::new (static_cast<void*>(slots_[index].bytes)) T(std::forward<Arguments>(arguments)...);
    --available_;
    in_use_[index] = true;
    if (used() > high_water_) high_water_ = used();
    return made;
  }

  // Destroys the object and frees its slot. A pointer that is not out of this pool breaks the contract.
  void release(T* object_out) noexcept {
    const std::uint32_t index = indexOf(object_out);
    assert(in_use_[index] && "released twice");
    std::destroy_at(object_out);
    in_use_[index] = false;
    free_indices_[available_++] = index;
  }

  // Slot number of an object of this pool, 0 to capacity() - 1: a small handle that crosses rings.
  [[nodiscard]] std::uint32_t indexOf(const T* object_out) const noexcept {
    const auto* bytes = reinterpret_cast<const std::byte*>(object_out);
    const auto* first = slots_[0].bytes;
    assert(bytes >= first && bytes < first + sizeof(Slot) * capacity_ && "not of this pool");
    const auto offset = static_cast<std::size_t>(bytes - first);
    assert(offset % sizeof(Slot) == 0 && "not the beginning of an object");
    return static_cast<std::uint32_t>(offset / sizeof(Slot));
  }
  // The object in a slot, nullptr when that slot is free.
  [[nodiscard]] T* at(std::uint32_t index) noexcept {
    assert(index < capacity_);
    return in_use_[index] ? object(index) : nullptr;
  }

  [[nodiscard]] std::uint32_t capacity() const noexcept { return capacity_; }
  [[nodiscard]] std::uint32_t used() const noexcept { return capacity_ - available_; }
  [[nodiscard]] std::uint32_t free() const noexcept { return available_; }
  [[nodiscard]] std::uint32_t highWater() const noexcept { return high_water_; }
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_; }

  // Bytes of arena that a pool takes, alignment padding aside: for the memory budget.
  [[nodiscard]] static constexpr std::size_t bytesFor(std::uint32_t capacity) noexcept {
    return (sizeof(Slot) + sizeof(std::uint32_t) + sizeof(bool)) * capacity;
  }

 private:
  struct Slot {
    alignas(T) std::byte bytes[sizeof(T)];
  };
  T* object(std::uint32_t index) noexcept { return std::launder(reinterpret_cast<T*>(slots_[index].bytes)); }

  Slot* slots_ = nullptr;
  std::uint32_t* free_indices_ = nullptr;  // a stack; the first `available_` are free
  bool* in_use_ = nullptr;
  std::uint32_t capacity_ = 0;
  std::uint32_t available_ = 0;
  std::uint32_t high_water_ = 0;
  std::uint64_t refused_ = 0;
};

}  // namespace fathom::rt
