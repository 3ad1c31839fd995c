#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "firmware_if/can/bus/can_source.hpp"
#include "tests/uml/bus_peer.hpp"

// What tests of CanSource on a real interface share; they run inside the user-mode Linux (`uml_run --can`).
namespace fathom::uml {

inline constexpr std::int64_t kSecond_ns = 1'000'000'000;

// Monotonic time from a fixed moment on, as the vehicle's.
class VehicleClock final : public rt::Clock {
 public:
  std::int64_t monotonicNs() const noexcept override { return real_.monotonicNs(); }
  std::int64_t utcNs() const noexcept override { return real_.monotonicNs() + kStart_ns; }
  void sleepUntil(std::int64_t monotonic_ns) noexcept override { real_.sleepUntil(monotonic_ns); }

 private:
  static constexpr std::int64_t kStart_ns = 1'700'000'000 * kSecond_ns;
  rt::RealClock real_;
};

struct Heard final : io::SampleSink {
  Heard() {
    samples.reserve(1000);
    raw_bytes.reserve(1 << 20);
  }
  void sample(std::int64_t arrival_utc_ns, const SensorSample& sample) noexcept override {
    last_arrival_ns = arrival_utc_ns;
    samples.push_back(sample);
  }
  void raw(std::int64_t arrival_utc_ns, std::string_view source,
           std::span<const std::uint8_t> bytes) noexcept override {
    EXPECT_EQ(source, "RAW_CAN");
    raw_bytes.insert(raw_bytes.end(), bytes.begin(), bytes.end());
    io::RawCanRecord record;
    while (io::readRawCan(bytes, arrival_utc_ns, record)) ++raw_frames;
    EXPECT_TRUE(bytes.empty());
  }
  template <class T>
  [[nodiscard]] std::vector<T> of() const {
    std::vector<T> out;
    for (const SensorSample& s : samples)
      if (const T* found = std::get_if<T>(&s)) out.push_back(*found);
    return out;
  }
  std::vector<SensorSample> samples;
  std::int64_t last_arrival_ns = 0;
  std::vector<std::uint8_t> raw_bytes;
  std::size_t raw_frames = 0;
};

inline std::uint64_t counter(const io::CanSource& source, std::string_view name) {
  for (const auto& [key, value] : source.health().counters)
    if (key == name) return value;
  ADD_FAILURE() << name << " is no counter";
  return 0;
}

inline void shell(const std::string& command) {
  ASSERT_EQ(std::system(command.c_str()), 0) << command;
}

}  // namespace fathom::uml
