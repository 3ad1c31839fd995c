#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace fathom::rt {

// Items numbered 0, 1, 2, ... in the order in which they are added, at most `capacity` at once: when it is
// full, one must be erased first. Numbers are never reused, so that the series continues indefinitely in the
// same memory. Finding an item takes log2(capacity) comparisons, erasing moves at most `capacity` pairs of
// numbers. For one thread; takes no memory after construction.
template <typename T>
class NumberedPool {
 public:
  explicit NumberedPool(std::size_t capacity) : capacity_(capacity) {
    numbers_.reserve(capacity);
    places_.reserve(capacity);
    items_.reserve(capacity);
    free_.reserve(capacity);
  }

  // Returns the item's number. Not when full().
  int add(const T& item) {
    assert(!full());
    std::int32_t place = 0;
    if (free_.empty()) {
      place = static_cast<std::int32_t>(items_.size());
      items_.push_back(item);
    } else {
      place = free_.back();
      free_.pop_back();
      items_[static_cast<std::size_t>(place)] = item;
    }
    numbers_.push_back(next_);
    places_.push_back(place);
    return next_++;
  }
  // The item must be present.
  void erase(int number) {
    const auto at = static_cast<std::ptrdiff_t>(position(number));
    assert(has(number));
    free_.push_back(places_[static_cast<std::size_t>(at)]);
    numbers_.erase(numbers_.begin() + at);
    places_.erase(places_.begin() + at);
  }

  [[nodiscard]] bool has(int number) const {
    const std::size_t at = position(number);
    return at < numbers_.size() && numbers_[at] == number;
  }
  // By number; the item must be present.
  [[nodiscard]] T& operator[](std::size_t number) { return items_[placeOf(number)]; }
  [[nodiscard]] const T& operator[](std::size_t number) const { return items_[placeOf(number)]; }
  [[nodiscard]] const T& back() const { return items_[static_cast<std::size_t>(places_.back())]; }

  // Numbers of the present items, rising.
  [[nodiscard]] std::span<const int> numbers() const { return numbers_; }
  // How many numbers are below `number`.
  [[nodiscard]] std::size_t position(int number) const {
    return static_cast<std::size_t>(std::lower_bound(numbers_.begin(), numbers_.end(), number) -
                                    numbers_.begin());
  }
  [[nodiscard]] int next() const { return next_; }  // number of the next item
  [[nodiscard]] std::size_t size() const { return numbers_.size(); }
  [[nodiscard]] bool empty() const { return numbers_.empty(); }
  [[nodiscard]] bool full() const { return numbers_.size() == capacity_; }
  [[nodiscard]] std::size_t capacity() const { return capacity_; }
  [[nodiscard]] std::size_t memoryBytes() const {
    return capacity_ * (sizeof(T) + sizeof(int) + 2 * sizeof(std::int32_t));
  }

  // For saved state (state_archive.hpp): the same items with the same numbers.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.next_);
    archive.bounded(self.numbers_, self.capacity_);
    if constexpr (Archive::kLoading) {
      int before = -1;
      for (const int number : self.numbers_) {
        archive.require(number > before && number < self.next_, "numbers that do not rise");
        before = number;
      }
      if (!archive.ok()) return;
      self.free_.clear();
      self.items_.resize(self.numbers_.size());
      self.places_.clear();
      for (std::size_t i = 0; i < self.numbers_.size(); ++i)
        self.places_.push_back(static_cast<std::int32_t>(i));
    }
    for (const std::int32_t place : self.places_) archive(self.items_[static_cast<std::size_t>(place)]);
  }

 private:
  [[nodiscard]] std::size_t placeOf(std::size_t number) const {
    assert(has(static_cast<int>(number)));
    return static_cast<std::size_t>(places_[position(static_cast<int>(number))]);
  }

  std::size_t capacity_;
  std::vector<int> numbers_;
  std::vector<std::int32_t> places_;  // in items_, of each number
  std::vector<T> items_;
  std::vector<std::int32_t> free_;  // places
  int next_ = 0;
};

}  // namespace fathom::rt
