#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

namespace fathom::io {

// A record of 8 byte numbers that one thread publishes and any thread reads. Each number is whole; a reader
// may see some of the newest and some of those before.
template <class Record>
class SharedWords {
  static_assert(std::is_trivially_copyable_v<Record> && sizeof(Record) % sizeof(std::uint64_t) == 0);
  static constexpr std::size_t kWords = sizeof(Record) / sizeof(std::uint64_t);

 public:
  void publish(const Record& record) noexcept {
    std::array<std::uint64_t, kWords> words;
    std::memcpy(words.data(), &record, sizeof record);
    for (std::size_t i = 0; i < kWords; ++i) words_[i].store(words[i], std::memory_order_relaxed);
  }
  [[nodiscard]] Record read() const noexcept {
    std::array<std::uint64_t, kWords> words;
    for (std::size_t i = 0; i < kWords; ++i) words[i] = words_[i].load(std::memory_order_relaxed);
    Record record;
    std::memcpy(static_cast<void*>(&record), words.data(), sizeof record);
    return record;
  }

 private:
  std::array<std::atomic<std::uint64_t>, kWords> words_{};
};

}  // namespace fathom::io
