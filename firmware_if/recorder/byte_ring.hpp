#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <span>
#include <vector>

#include "realtime/kernel/rings/spsc_ring.hpp"

namespace fathom::io {

// Records of any length from exactly one producing thread to exactly one consuming thread, in memory taken
// and touched at construction; wait-free on both sides. Full: push refuses the record and counts it.
class ByteRing {
 public:
  // Rounded up to a power of two of at least 4 KiB.
  explicit ByteRing(std::size_t bytes) : memory_(powerOfTwo(bytes), 0) {}
  ByteRing(const ByteRing&) = delete;
  ByteRing& operator=(const ByteRing&) = delete;

  // Producer only: one record, the parts one behind the other, at most mostBytes() together.
  [[nodiscard]] bool push(std::initializer_list<std::span<const std::uint8_t>> parts) noexcept {
    std::size_t size = 0;
    for (const auto& part : parts) size += part.size();
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    const std::size_t used = tail - head_.load(std::memory_order_acquire);
    const std::size_t at = tail % memory_.size();
    const std::size_t whole = kSizeBytes + rounded(size);
    // A record is in one piece: too little room at the end of the memory is passed over.
    const std::size_t passed_over = at + whole > memory_.size() ? memory_.size() - at : 0;
    if (size > mostBytes() || used + passed_over + whole > memory_.size()) {
      refused_.store(refused_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
      return false;
    }
    if (passed_over > 0) putSize(at, kPassOver);
    std::size_t to = (at + passed_over) % memory_.size();
    putSize(to, size);
    to += kSizeBytes;
    for (const auto& part : parts) {
      if (!part.empty()) std::memcpy(memory_.data() + to, part.data(), part.size());
      to += part.size();
    }
    tail_.store(tail + passed_over + whole, std::memory_order_release);
    const std::size_t now_used = used + passed_over + whole;
    if (now_used > high_water_.load(std::memory_order_relaxed))
      high_water_.store(now_used, std::memory_order_relaxed);
    return true;
  }

  // Consumer only: the oldest record, until pop(); empty when there is none (records are never empty).
  [[nodiscard]] std::span<const std::uint8_t> front() noexcept {
    std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_.load(std::memory_order_acquire)) return {};
    std::size_t at = head % memory_.size();
    if (sizeAt(at) == kPassOver) {
      head += memory_.size() - at;
      head_.store(head, std::memory_order_release);
      at = 0;
    }
    return {memory_.data() + at + kSizeBytes, sizeAt(at)};
  }
  // Consumer only, after front() gave a record.
  void pop() noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    head_.store(head + kSizeBytes + rounded(sizeAt(head % memory_.size())), std::memory_order_release);
  }

  [[nodiscard]] std::size_t mostBytes() const noexcept { return memory_.size() / 4; }  // of one record
  [[nodiscard]] std::size_t capacity() const noexcept { return memory_.size(); }
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::size_t highWater() const noexcept { return high_water_.load(std::memory_order_relaxed); }

 private:
  static constexpr std::size_t kSizeBytes = 8;
  static constexpr std::uint64_t kPassOver = UINT64_MAX;

  static std::size_t powerOfTwo(std::size_t bytes) {
    std::size_t size = 4096;
    while (size < bytes) size *= 2;
    return size;
  }
  static std::size_t rounded(std::size_t size) noexcept {
    return (size + kSizeBytes - 1) / kSizeBytes * kSizeBytes;
  }
  void putSize(std::size_t at, std::uint64_t size) noexcept {
    std::memcpy(memory_.data() + at, &size, kSizeBytes);
  }
  [[nodiscard]] std::uint64_t sizeAt(std::size_t at) const noexcept {
    std::uint64_t size;
    std::memcpy(&size, memory_.data() + at, kSizeBytes);
    return size;
  }

  std::vector<std::uint8_t> memory_;
  alignas(rt::kCacheLine) std::atomic<std::size_t> tail_{0};
  std::atomic<std::size_t> high_water_{0};
  std::atomic<std::uint64_t> refused_{0};
  alignas(rt::kCacheLine) std::atomic<std::size_t> head_{0};
};

}  // namespace fathom::io
