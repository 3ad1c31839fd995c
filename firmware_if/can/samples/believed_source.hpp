#pragma once

#include <cstdint>
#include <optional>

namespace fathom::io {

// Which address on the bus is believed for one quantity: the configured one, or the first that is heard. A
// device that was only heard first may lose its address or die: after `switch_after_ns` of silence the next
// address that is heard takes over.
class BelievedSource {
 public:
  BelievedSource() = default;
  BelievedSource(std::optional<std::uint8_t> configured, std::int64_t switch_after_ns) noexcept
      : source_(configured), configured_(configured.has_value()), switch_after_ns_(switch_after_ns) {}

  [[nodiscard]] bool believe(std::uint8_t source, std::int64_t utc_ns) noexcept {
    if (!configured_ && source_ != source) {
      if (source_ && utc_ns - last_ns_ < switch_after_ns_) return false;
      changes_ += source_ ? 1 : 0;
      source_ = source;
    }
    if (source_ != source) return false;
    last_ns_ = utc_ns;
    return true;
  }

  [[nodiscard]] bool is(std::uint8_t source) const noexcept { return source_ == source; }
  [[nodiscard]] std::uint64_t changes() const noexcept { return changes_; }

 private:
  std::optional<std::uint8_t> source_;
  bool configured_ = false;
  std::int64_t switch_after_ns_ = 0;
  std::int64_t last_ns_ = 0;
  std::uint64_t changes_ = 0;
};

}  // namespace fathom::io
