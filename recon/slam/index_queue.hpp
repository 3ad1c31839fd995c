#pragma once

#include <span>

namespace fathom::slam {

// First in, first out, of indices, in memory that another owns. Its user puts in no more than it has room
// for.
class IndexQueue {
 public:
  IndexQueue() = default;
  explicit IndexQueue(std::span<int> room) : room_(room) {}

  void clear() { first_ = count_ = 0; }
  [[nodiscard]] bool empty() const { return count_ == 0; }
  [[nodiscard]] int size() const { return count_; }
  [[nodiscard]] int front() const { return room_[static_cast<std::size_t>(first_)]; }
  void push(int index) {
    const int room = static_cast<int>(room_.size());
    room_[static_cast<std::size_t>((first_ + count_++) % room)] = index;
  }
  void pop() {
    first_ = (first_ + 1) % static_cast<int>(room_.size());
    --count_;
  }

 private:
  std::span<int> room_;
  int first_ = 0, count_ = 0;
};

}  // namespace fathom::slam
