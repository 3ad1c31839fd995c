#pragma once

#include <gtest/gtest.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <string_view>
#include <variant>
#include <vector>

#include "firmware_if/devices/can/bus/can_source.hpp"
#include "realtime/base/units.hpp"

// Shared by the tests of CanSource on a real interface, which run inside the user-mode Linux (`uml_run
// --can`).
namespace fathom::uml {

// Another device on the bus: a raw socket without filters, written apart from the code under test.
class BusPeer {
 public:
  explicit BusPeer(const char* interface) : fd_(::socket(PF_CAN, SOCK_RAW, CAN_RAW)) {
    ifreq request = {};
    std::strncpy(request.ifr_name, interface, IFNAMSIZ - 1);
    sockaddr_can address = {};
    address.can_family = AF_CAN;
    if (::ioctl(fd_, SIOCGIFINDEX, &request) != 0) std::abort();
    address.can_ifindex = request.ifr_ifindex;
    if (::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) std::abort();
  }
  ~BusPeer() { ::close(fd_); }
  BusPeer(const BusPeer&) = delete;
  BusPeer& operator=(const BusPeer&) = delete;

  // `id` with the flags of linux/can.h.
  bool send(std::uint32_t id, const std::vector<std::uint8_t>& data) {
    can_frame frame = {};
    frame.can_id = id;
    frame.len = static_cast<std::uint8_t>(data.size());
    std::copy(data.begin(), data.end(), frame.data);
    return ::write(fd_, &frame, sizeof frame) == sizeof frame;
  }
  bool send(std::uint32_t pgn, std::uint8_t source, const std::vector<std::uint8_t>& data) {
    return send((3U << 26) | (pgn << 8) | source | CAN_EFF_FLAG, data);
  }
  std::optional<can_frame> receive(int timeout_ms) {
    pollfd socket = {fd_, POLLIN, 0};
    can_frame frame = {};
    if (::poll(&socket, 1, timeout_ms) != 1 || ::read(fd_, &frame, sizeof frame) != sizeof frame)
      return std::nullopt;
    return frame;
  }

 private:
  int fd_;
};

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

struct ReceivedSamples final : io::SampleSink {
  ReceivedSamples() {
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
