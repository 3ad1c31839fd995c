#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include "firmware_if/devices/modem/modem_ports.hpp"
#include "sim/link/channel.hpp"
#include "tests/support/pty_line.hpp"

namespace fathom::sim {
namespace {

using Bytes = std::vector<std::uint8_t>;

// Two connected ports, and a source of disturbances at the second.
class JoinedPorts {
 public:
  virtual ~JoinedPorts() = default;
  virtual FramePort& vehicle() = 0;
  virtual FramePort& ship() = 0;
  // Delivers frames in transit.
  virtual void settle() = 0;
  // Bytes that are no frame reach the ship's side as the medium carries them.
  virtual void disturb(const Bytes& bytes) = 0;
};

// Two serial ports at 9600 baud, each on a pseudo-terminal; the pump between them is the cable. A
// pseudo-terminal has no rate of its own: this tests the line's settings and the framing, not its pace.
class SerialCable final : public JoinedPorts {
 public:
  SerialCable() : vehicle_(ends_[0].name(), 9600), ship_(ends_[1].name(), 9600) {}
  FramePort& vehicle() override { return vehicle_; }
  FramePort& ship() override { return ship_; }
  void settle() override {
    while (pump(0, 1) || pump(1, 0)) continue;
  }
  void disturb(const Bytes& bytes) override { ends_[1].send(bytes); }

 private:
  bool pump(std::size_t from, std::size_t to) {
    Bytes bytes(1024);
    const ssize_t n = ends_[from].read(bytes, 1);
    if (n > 0) ends_[to].send(std::span(bytes).first(static_cast<std::size_t>(n)));
    return n > 0;
  }
  std::array<test::PtyLine, 2> ends_;
  io::SerialFramePort vehicle_, ship_;
};

class UdpPair final : public JoinedPorts {
 public:
  UdpPair() : ship_("127.0.0.1", 0, "", 0), vehicle_("127.0.0.1", 0, "127.0.0.1", ship_.boundPort()) {
    // The ship learns where the vehicle is.
    std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer{};
    EXPECT_TRUE(vehicle_.send(Bytes{0}));
    settle();
    EXPECT_EQ(ship_.receive(buffer), 1U);
    ship_.answerLastSender();
  }
  FramePort& vehicle() override { return vehicle_; }
  FramePort& ship() override { return ship_; }
  // Datagrams over the loopback are there when sendto returns.
  void settle() override {}
  // Too long for a frame, and empty ones.
  void disturb(const Bytes& bytes) override {
    const int socket = ::socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in to = {};
    to.sin_family = AF_INET;
    to.sin_port = htons(ship_.boundPort());
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    (void)::sendto(socket, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&to), sizeof to);
    ::close(socket);
  }

 private:
  io::UdpFramePort ship_, vehicle_;
};

// The simulated channel, with nothing lost.
class Water final : public JoinedPorts {
 public:
  explicit Water(bool half_duplex) : pair_(clear(), clear(), half_duplex) {}
  FramePort& vehicle() override { return pair_.vehicle(); }
  FramePort& ship() override { return pair_.ship(); }
  void settle() override { pair_.advance(now_s_ += 3600); }
  // The water carries frames only; one too long is refused where it starts.
  void disturb(const Bytes& bytes) override { EXPECT_FALSE(pair_.vehicle().send(bytes)); }

 private:
  static ChannelConfig clear() {
    ChannelConfig config;
    config.loss = config.duplicate = config.reorder = config.corrupt = 0;
    config.rate_bps = 300;
    return config;
  }
  ChannelPair pair_;
  double now_s_ = 0;
};

struct Kind {
  const char* name;
  std::function<std::unique_ptr<JoinedPorts>()> make;
};

class FramePorts : public ::testing::TestWithParam<Kind> {
 protected:
  FramePorts() : joined_(GetParam().make()) {}
  Bytes receive(FramePort& port) {
    joined_->settle();
    Bytes buffer(FramePort::kMaxFrameBytes);
    buffer.resize(port.receive(buffer));
    return buffer;
  }
  FramePort& vehicle() { return joined_->vehicle(); }
  FramePort& ship() { return joined_->ship(); }
  std::unique_ptr<JoinedPorts> joined_;
};

Bytes numbered(int number, std::size_t size) {
  Bytes frame(size);
  std::mt19937 random(static_cast<unsigned>(number));
  for (std::uint8_t& b : frame) b = static_cast<std::uint8_t>(random());
  return frame;
}

TEST_P(FramePorts, FramesOfEverySizeArriveCompleteAndInOrderInBothDirections) {
  for (std::size_t size = 1; size <= FramePort::kMaxFrameBytes; ++size) {
    const Bytes up = numbered(static_cast<int>(size), size), down = numbered(-static_cast<int>(size), size);
    ASSERT_TRUE(vehicle().send(up));
    EXPECT_EQ(receive(ship()), up) << size;
    ASSERT_TRUE(ship().send(down));
    EXPECT_EQ(receive(vehicle()), down) << size;
  }
  EXPECT_TRUE(receive(ship()).empty());
  EXPECT_TRUE(receive(vehicle()).empty());
  EXPECT_EQ(vehicle().droppedFrames() + ship().droppedFrames(), 0U);
}

TEST_P(FramePorts, EveryByteIsCarriedAsItIs) {
  for (int value = 0; value < 256; ++value) {
    const Bytes frame(7, static_cast<std::uint8_t>(value));
    ASSERT_TRUE(vehicle().send(frame));
    EXPECT_EQ(receive(ship()), frame) << value;
  }
}

TEST_P(FramePorts, FramesThatWaitKeepTheirOrderAndTheirBorders) {
  std::vector<Bytes> sent;
  for (int i = 0; i < 10; ++i) {
    sent.push_back(numbered(i, static_cast<std::size_t>(1 + 7 * i)));
    ASSERT_TRUE(vehicle().send(sent.back()));
  }
  for (const Bytes& frame : sent) EXPECT_EQ(receive(ship()), frame);
  EXPECT_TRUE(receive(ship()).empty());
}

TEST_P(FramePorts, NothingToReceiveIsAnAnswerNotAWait) {
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer{};
  for (int i = 0; i < 1000; ++i) EXPECT_EQ(ship().receive(buffer), 0U);
}

TEST_P(FramePorts, EmptyAndTooLongFramesAreRefused) {
  EXPECT_FALSE(vehicle().send({}));
  EXPECT_FALSE(vehicle().send(Bytes(FramePort::kMaxFrameBytes + 1)));
  EXPECT_TRUE(receive(ship()).empty());
  ASSERT_TRUE(vehicle().send(Bytes{1}));
  EXPECT_EQ(receive(ship()), Bytes{1});
}

TEST_P(FramePorts, OverloadRefusesNewFramesAndCutsNone) {
  constexpr int kMany = 3000;
  int taken = 0;
  std::vector<bool> was_taken;
  for (int i = 0; i < kMany; ++i) {
    Bytes frame = numbered(i, FramePort::kMaxFrameBytes);
    frame[0] = static_cast<std::uint8_t>(i), frame[1] = static_cast<std::uint8_t>(i >> 8);
    was_taken.push_back(vehicle().send(frame));
    taken += was_taken.back();
  }
  ASSERT_GT(taken, 0);
  int arrived = 0, last = -1;
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer{};
  for (int idle = 0; idle < 10; ++idle) {
    joined_->settle();
    (void)vehicle().receive(buffer);  // drives out what the line had not taken yet
    while (const std::size_t size = ship().receive(buffer)) {
      idle = 0;
      ASSERT_EQ(size, FramePort::kMaxFrameBytes);
      const int number = buffer[0] | buffer[1] << 8;
      ASSERT_LT(number, kMany);
      EXPECT_TRUE(was_taken[static_cast<std::size_t>(number)]) << "a refused frame was sent";
      EXPECT_GT(number, last);
      Bytes expected = numbered(number, FramePort::kMaxFrameBytes);
      EXPECT_TRUE(std::equal(expected.begin() + 2, expected.end(), buffer.begin() + 2)) << number;
      last = number;
      ++arrived;
    }
  }
  EXPECT_GT(arrived, 0);
  EXPECT_LE(arrived, taken);
  ASSERT_TRUE(vehicle().send(Bytes{7})) << "it continues afterwards";
  EXPECT_EQ(receive(ship()), Bytes{7});
}

TEST_P(FramePorts, GarbageIsNoFrameAndTheNextFrameArrives) {
  joined_->disturb(Bytes(FramePort::kMaxFrameBytes + 40, 0x55));
  ASSERT_TRUE(vehicle().send(Bytes{1, 2, 3}));
  joined_->settle();
  EXPECT_EQ(receive(ship()), (Bytes{1, 2, 3}));
}

TEST_P(FramePorts, AFloodOfGarbageEndsAtEachCall) {
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer{};
  for (int i = 0; i < 8; ++i) {
    joined_->disturb(Bytes(FramePort::kMaxFrameBytes + 100, static_cast<std::uint8_t>(0x20 + i)));
    for (int k = 0; k < 10; ++k) EXPECT_EQ(ship().receive(buffer), 0U);
  }
  ASSERT_TRUE(vehicle().send(Bytes{9}));
  EXPECT_EQ(receive(ship()), Bytes{9});
}

INSTANTIATE_TEST_SUITE_P(
    All, FramePorts,
    ::testing::Values(
        Kind{"Serial", [] { return std::unique_ptr<JoinedPorts>(std::make_unique<SerialCable>()); }},
        Kind{"Udp", [] { return std::unique_ptr<JoinedPorts>(std::make_unique<UdpPair>()); }},
        Kind{"Water", [] { return std::unique_ptr<JoinedPorts>(std::make_unique<Water>(false)); }},
        Kind{"HalfDuplexWater", [] { return std::unique_ptr<JoinedPorts>(std::make_unique<Water>(true)); }}),
    [](const auto& kind) { return kind.param.name; });

}  // namespace
}  // namespace fathom::sim
