#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>

namespace fathom::rt {

// A fixed set of named event counters, one for each value 0 to Count - 1 of an enumeration. Any thread may
// count, any thread may read; each value is right, but a snapshot taken while others count is not one
// instant.
template <typename Id, std::size_t Count>
class HealthCounters {
  static_assert(std::is_enum_v<Id> && Count > 0);

 public:
  struct Entry {
    std::string_view name;
    std::uint64_t value = 0;
  };
  using Snapshot = std::array<Entry, Count>;

  // `names` in the order of the enumeration; the texts must outlive the counters (literals).
  explicit HealthCounters(const std::array<std::string_view, Count>& names) noexcept : names_(names) {}

  void add(Id id, std::uint64_t events = 1) noexcept {
    values_.at(static_cast<std::size_t>(id)).fetch_add(events, std::memory_order_relaxed);
  }
  [[nodiscard]] std::uint64_t value(Id id) const noexcept {
    return values_.at(static_cast<std::size_t>(id)).load(std::memory_order_relaxed);
  }
  [[nodiscard]] Snapshot snapshot() const noexcept {
    Snapshot all;
    for (std::size_t i = 0; i < Count; ++i) all[i] = {names_[i], values_[i].load(std::memory_order_relaxed)};
    return all;
  }

 private:
  std::array<std::string_view, Count> names_;
  std::array<std::atomic<std::uint64_t>, Count> values_{};
};

}  // namespace fathom::rt
