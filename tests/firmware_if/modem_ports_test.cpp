#include "firmware_if/devices/modem/modem_ports.hpp"

#include <gmock/gmock.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include "tests/support/pty_line.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::io {
namespace {

using test::refusal, ::testing::HasSubstr;

using Bytes = std::vector<std::uint8_t>;

// Frames that need every kind of escape, of the smallest and the largest size.
std::vector<Bytes> awkwardFrames() {
  Bytes all(256);
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<std::uint8_t>(i);
  constexpr std::size_t kMost = FramePort::kMaxFrameBytes;
  return {{0xC0}, {0xDB}, {0xC0, 0xDB, 0xDC, 0xDD, 0xC0}, all, Bytes(kMost, 0xC0), Bytes(kMost, 0xDB), {0}};
}

Bytes encoded(const Bytes& frame) {
  Bytes line(kMaxSlipBytes);
  line.resize(slipEncode(frame, line));
  return line;
}

std::vector<Bytes> decoded(SlipDecoder& decoder, const Bytes& line) {
  std::vector<Bytes> frames;
  for (const std::uint8_t byte : line)
    if (decoder.push(byte)) frames.emplace_back(decoder.frame().begin(), decoder.frame().end());
  return frames;
}

TEST(Slip, AwkwardFramesComeBack) {
  SlipDecoder decoder;
  for (const Bytes& frame : awkwardFrames())
    EXPECT_THAT(decoded(decoder, encoded(frame)), testing::ElementsAre(frame));
  EXPECT_EQ(decoder.dropped(), 0u);
}

TEST(Slip, EmptyAndTooLongFramesAreNotSent) {
  Bytes line(kMaxSlipBytes);
  EXPECT_EQ(slipEncode({}, line), 0u);
  EXPECT_EQ(slipEncode(Bytes(FramePort::kMaxFrameBytes + 1), line), 0u);
  EXPECT_EQ(slipEncode(Bytes(1), std::span(line).first(10)), 0u);
}

TEST(Slip, ALostByteDamagesOneFrameOnly) {
  const Bytes first = {1, 2, 3, 0xC0, 4}, second = {5, 0xDB, 6}, third = {7};
  Bytes line;
  for (const Bytes& frame : {first, second, third}) {
    const Bytes part = encoded(frame);
    line.insert(line.end(), part.begin(), part.end());
  }
  for (std::size_t lost = 0; lost < line.size(); ++lost) {
    Bytes rest = line;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(lost));
    SlipDecoder decoder;
    const auto frames = decoded(decoder, rest);
    int whole = 0;
    for (const Bytes& frame : frames) whole += frame == first || frame == second || frame == third ? 1 : 0;
    EXPECT_GE(whole, 2) << "byte " << lost;
  }
}

TEST(Slip, TooLongFramesAndFalseEscapesAreDroppedAndCounted) {
  SlipDecoder decoder;
  Bytes line(FramePort::kMaxFrameBytes + 1, 1);
  line.push_back(0xC0);
  EXPECT_TRUE(decoded(decoder, line).empty());
  EXPECT_EQ(decoder.dropped(), 1u);
  EXPECT_TRUE(decoded(decoder, {5, 0xDB, 7, 0xC0}).empty());
  EXPECT_TRUE(decoded(decoder, {5, 0xDB, 0xC0}).empty());
  EXPECT_EQ(decoder.dropped(), 3u);
  EXPECT_THAT(decoded(decoder, {9, 0xC0}), testing::ElementsAre(Bytes{9}));
}

Bytes receiveOne(FramePort& port) {
  Bytes buffer(FramePort::kMaxFrameBytes);
  // Local delivery may take a moment.
  for (int i = 0; i < 1000; ++i) {
    const std::size_t n = port.receive(buffer);
    if (n > 0) {
      buffer.resize(n);
      return buffer;
    }
    ::usleep(1000);
  }
  return {};
}

TEST(UdpFramePort, FramesArriveWholeAndNothingElse) {
  UdpFramePort receiver("127.0.0.1", 0, "", 0);
  UdpFramePort sender("127.0.0.1", 0, "127.0.0.1", receiver.boundPort());
  for (const Bytes& frame : awkwardFrames()) {
    ASSERT_TRUE(sender.send(frame));
    EXPECT_EQ(receiveOne(receiver), frame);
  }
  Bytes buffer(FramePort::kMaxFrameBytes);
  EXPECT_EQ(receiver.receive(buffer), 0u);
  EXPECT_FALSE(sender.send({}));
  EXPECT_FALSE(sender.send(Bytes(FramePort::kMaxFrameBytes + 1)));
  EXPECT_EQ(receiver.droppedFrames(), 0u);
}

TEST(UdpFramePort, APortWithoutAPeerAnswersTheSenderOfTheLastValidFrame) {
  UdpFramePort ship("127.0.0.1", 0, "", 0);
  EXPECT_FALSE(ship.send(Bytes(1))) << "no frame has come yet";
  UdpFramePort first("127.0.0.1", 0, "127.0.0.1", ship.boundPort());
  UdpFramePort second("127.0.0.1", 0, "127.0.0.1", ship.boundPort());
  ASSERT_TRUE(first.send(Bytes{1}));
  EXPECT_EQ(receiveOne(ship), Bytes{1});
  EXPECT_FALSE(ship.send(Bytes(1))) << "what was received may be noise";
  ship.answerLastSender();
  ASSERT_TRUE(ship.send(Bytes{2}));
  EXPECT_EQ(receiveOne(first), Bytes{2});
  ASSERT_TRUE(second.send(Bytes{3}));
  EXPECT_EQ(receiveOne(ship), Bytes{3});
  ship.answerLastSender();
  ASSERT_TRUE(ship.send(Bytes{4}));
  EXPECT_EQ(receiveOne(second), Bytes{4});
}

TEST(UdpFramePort, AForgedDatagramDoesNotLeadTheDownlinkAway) {
  UdpFramePort ship("127.0.0.1", 0, "", 0);
  UdpFramePort vehicle("127.0.0.1", 0, "127.0.0.1", ship.boundPort());
  UdpFramePort forger("127.0.0.1", 0, "127.0.0.1", ship.boundPort());
  ASSERT_TRUE(vehicle.send(Bytes{1}));
  EXPECT_EQ(receiveOne(ship), Bytes{1});
  ship.answerLastSender();
  ASSERT_TRUE(forger.send(Bytes{9}));
  EXPECT_EQ(receiveOne(ship), Bytes{9});
  ASSERT_TRUE(ship.send(Bytes{2}));
  EXPECT_EQ(receiveOne(vehicle), Bytes{2});
  Bytes buffer(FramePort::kMaxFrameBytes);
  EXPECT_EQ(forger.receive(buffer), 0u);
}

TEST(UdpFramePort, APortWithAPeerReceivesFromNobodyElse) {
  UdpFramePort peer("127.0.0.1", 0, "", 0);
  UdpFramePort port("127.0.0.1", 0, "127.0.0.1", peer.boundPort());
  UdpFramePort stranger("127.0.0.1", 0, "127.0.0.1", port.boundPort());
  ASSERT_TRUE(stranger.send(Bytes{9}));
  ASSERT_TRUE(port.send(Bytes{1}));
  EXPECT_EQ(receiveOne(peer), Bytes{1});
  peer.answerLastSender();
  ASSERT_TRUE(peer.send(Bytes{2}));
  EXPECT_EQ(receiveOne(port), Bytes{2});
  EXPECT_EQ(port.droppedFrames(), 1u);
}

TEST(UdpFramePort, APeerThatIsNotThereIsSilence) {
  std::uint16_t closed = 0;
  {
    const UdpFramePort gone("127.0.0.1", 0, "", 0);
    closed = gone.boundPort();
  }
  UdpFramePort port("127.0.0.1", 0, "127.0.0.1", closed);
  Bytes buffer(FramePort::kMaxFrameBytes);
  for (int i = 0; i < 3; ++i) {
    (void)port.send(Bytes{1});
    EXPECT_EQ(port.receive(buffer), 0u);
  }
  UdpFramePort back("127.0.0.1", closed, "", 0);
  ASSERT_TRUE(port.send(Bytes{5}));
  EXPECT_EQ(receiveOne(back), Bytes{5});
}

TEST(UdpFramePort, DatagramsThatAreNoFramesAreDroppedAndCounted) {
  UdpFramePort receiver("127.0.0.1", 0, "", 0);
  UdpFramePort sender("127.0.0.1", 0, "127.0.0.1", receiver.boundPort());
  const int stranger = ::socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in to = {};
  to.sin_family = AF_INET;
  to.sin_port = htons(receiver.boundPort());
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  for (const std::size_t size : {FramePort::kMaxFrameBytes + 1, std::size_t{0}, std::size_t{9000}}) {
    const Bytes datagram(size, 7);
    ASSERT_EQ(::sendto(stranger, datagram.data(), size, 0, reinterpret_cast<sockaddr*>(&to), sizeof to),
              static_cast<ssize_t>(size));
  }
  ::close(stranger);
  ASSERT_TRUE(sender.send(Bytes{1, 2}));
  EXPECT_EQ(receiveOne(receiver), (Bytes{1, 2}));
  EXPECT_EQ(receiver.droppedFrames(), 3u);
}

TEST(UdpFramePort, AddressesThatCannotBeUsedAreRefused) {
  EXPECT_THAT(refusal([] { UdpFramePort port("nonsense", 0, "", 0); }), HasSubstr("nonsense is no IPv4"));
  EXPECT_THAT(refusal([] { UdpFramePort port("127.0.0.1", 0, "", 9); }), HasSubstr("is no IPv4"));
  EXPECT_THAT(refusal([] { UdpFramePort port("192.0.2.1", 0, "", 0); }),
              HasSubstr("192.0.2.1:0: cannot be bound"));
  UdpFramePort first("127.0.0.1", 0, "", 0);
  EXPECT_THAT(refusal([&] { UdpFramePort port("127.0.0.1", first.boundPort(), "", 0); }),
              HasSubstr("cannot be bound"));
}

class SerialFramePortTest : public ::testing::Test {
 protected:
  void write(const Bytes& bytes) const { modem_.send(bytes); }
  // So many bytes of what the port has sent.
  [[nodiscard]] Bytes read(std::size_t size) const {
    Bytes bytes(size);
    for (std::size_t at = 0; at < size;) {
      const ssize_t n = modem_.read(std::span(bytes).subspan(at), 1000);
      if (n <= 0) break;
      at += static_cast<std::size_t>(n);
    }
    return bytes;
  }
  test::PtyLine modem_;
};

TEST_F(SerialFramePortTest, TheLineIsRawAtItsRate) {
  const SerialFramePort port(modem_.name(), 9600);
  termios settings = {};
  ASSERT_EQ(::tcgetattr(modem_.line(), &settings), 0);
  EXPECT_EQ(::cfgetospeed(&settings), static_cast<speed_t>(B9600));
  EXPECT_EQ(::cfgetispeed(&settings), static_cast<speed_t>(B9600));
  EXPECT_EQ(settings.c_cflag & CSIZE, static_cast<tcflag_t>(CS8));
  EXPECT_EQ(settings.c_cflag & (PARENB | CSTOPB), 0u);
  EXPECT_EQ(settings.c_lflag & (ICANON | ECHO | ISIG), 0u);
  EXPECT_EQ(settings.c_iflag & (IXON | ICRNL), 0u);
}

TEST_F(SerialFramePortTest, FramesGoOutEscapedAndComeBack) {
  SerialFramePort port(modem_.name(), 9600);
  for (const Bytes& frame : awkwardFrames()) {
    ASSERT_TRUE(port.send(frame));
    EXPECT_EQ(read(encoded(frame).size()), encoded(frame));
    write(encoded(frame));
    EXPECT_EQ(receiveOne(port), frame);
  }
}

TEST_F(SerialFramePortTest, FramesInPiecesAmongNoiseAreFound) {
  SerialFramePort port(modem_.name(), 9600);
  Bytes buffer(FramePort::kMaxFrameBytes);
  const Bytes frame = {1, 0xC0, 2};
  Bytes line = {0x55, 0xDB, 0x11};  // noise; the END before the frame ends it
  const Bytes part = encoded(frame);
  line.insert(line.end(), part.begin(), part.end());
  for (std::size_t i = 0; i + 1 < line.size(); ++i) {
    write({line[i]});
    EXPECT_EQ(port.receive(buffer), 0u);
  }
  write({line.back()});
  EXPECT_EQ(receiveOne(port), frame);
  EXPECT_EQ(port.droppedFrames(), 1u);
  write(Bytes(FramePort::kMaxFrameBytes + 100, 0x55));
  write(encoded({3}));
  EXPECT_EQ(receiveOne(port), Bytes{3});
  EXPECT_EQ(port.droppedFrames(), 2u);
}

TEST_F(SerialFramePortTest, TwoFramesInOneReadAreTwoFrames) {
  SerialFramePort port(modem_.name(), 9600);
  Bytes line = encoded({1, 2});
  const Bytes second = encoded({3});
  line.insert(line.end(), second.begin(), second.end());
  write(line);
  EXPECT_EQ(receiveOne(port), (Bytes{1, 2}));
  EXPECT_EQ(receiveOne(port), Bytes{3});
}

TEST_F(SerialFramePortTest, AFullDeviceRefusesFramesAndCutsNone) {
  SerialFramePort port(modem_.name(), 9600);
  std::size_t sent = 0;
  const Bytes frame(256, 0xC0);
  while (sent < 10'000 && port.send(frame)) ++sent;
  ASSERT_GT(sent, 0u);
  ASSERT_LT(sent, 10'000u) << "the device took everything";
  SlipDecoder decoder;
  std::size_t received = 0;
  Bytes bytes(4096), buffer(FramePort::kMaxFrameBytes);
  for (int i = 0; i < 1000 && received < sent; ++i) {
    (void)port.receive(buffer);  // drives the rest of the last frame out, too
    const ssize_t n = modem_.read(bytes, 1);
    for (ssize_t k = 0; k < n; ++k) {
      if (!decoder.push(bytes[static_cast<std::size_t>(k)])) continue;
      EXPECT_EQ(Bytes(decoder.frame().begin(), decoder.frame().end()), frame);
      ++received;
    }
  }
  EXPECT_EQ(received, sent);
  EXPECT_EQ(decoder.dropped(), 0u);
  EXPECT_TRUE(port.send({frame.data(), 1}));
}

TEST_F(SerialFramePortTest, DevicesAndRatesThatCannotBeUsedAreRefused) {
  EXPECT_THAT(refusal([&] { SerialFramePort port(modem_.name(), 9601); }),
              HasSubstr("9601 baud is not one of 300"));
  EXPECT_THAT(refusal([] { SerialFramePort port("/nowhere/ttyS0", 9600); }), HasSubstr("cannot be opened"));
  EXPECT_THAT(refusal([] { SerialFramePort port("/dev/null", 9600); }), HasSubstr("is no serial device"));
}

TEST_F(SerialFramePortTest, AnUnpluggedModemIsOpenedAgainWhenItIsBack) {
  SerialFramePort port(modem_.name(), 9600, 0);
  write(encoded({1}));
  EXPECT_EQ(receiveOne(port), Bytes{1});
  const Bytes half = encoded({2, 3, 4});
  write(Bytes(half.begin(), half.begin() + 3));
  Bytes buffer(FramePort::kMaxFrameBytes);
  EXPECT_EQ(port.receive(buffer), 0u);
  modem_.unplug();
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(port.receive(buffer), 0u);
    EXPECT_FALSE(port.send(Bytes{1}));
  }
  EXPECT_FALSE(port.isOpen());
  EXPECT_EQ(port.disconnects(), 1u);

  modem_.plug();
  EXPECT_EQ(port.receive(buffer), 0u);
  EXPECT_TRUE(port.isOpen());
  write(encoded({5}));
  EXPECT_EQ(receiveOne(port), Bytes{5}) << "the half frame from before is gone";
  EXPECT_EQ(port.droppedFrames(), 1u);
  EXPECT_TRUE(port.send(Bytes{6}));
  EXPECT_EQ(read(encoded({6}).size()), encoded({6}));
  termios settings = {};
  ASSERT_EQ(::tcgetattr(modem_.line(), &settings), 0);
  EXPECT_EQ(::cfgetospeed(&settings), static_cast<speed_t>(B9600));
}

TEST_F(SerialFramePortTest, AModemThatComesLaterIsOpenedThenAndUsed) {
  modem_.unplug();
  const std::string name = modem_.name();
  WaitingFramePort port([name] { return std::make_unique<SerialFramePort>(name, 9600, 0); }, 0);
  Bytes buffer(FramePort::kMaxFrameBytes);
  EXPECT_FALSE(port.isOpen());
  EXPECT_THAT(std::string(port.reason()), HasSubstr("cannot be opened"));
  EXPECT_FALSE(port.send(Bytes{1}));
  EXPECT_EQ(port.receive(buffer), 0u);
  EXPECT_EQ(port.droppedFrames(), 0u);
  modem_.plug();
  ASSERT_TRUE(port.send(Bytes{7}));
  EXPECT_TRUE(port.isOpen());
  EXPECT_EQ(port.reason(), "");
  modem_.send(encoded({9}));
  EXPECT_EQ(receiveOne(port), Bytes{9});
  modem_.unplug();
  EXPECT_EQ(port.receive(buffer), 0u);
  EXPECT_FALSE(port.isOpen());
  EXPECT_NE(port.reason(), "");
}

TEST(WaitingFramePort, ADeviceThatIsAbsentIsTriedAtGrowingIntervals) {
  int tries = 0;
  WaitingFramePort port([&tries]() -> std::unique_ptr<FramePort> {
    ++tries;
    throw std::bad_alloc();
  });
  Bytes buffer(FramePort::kMaxFrameBytes);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(port.receive(buffer), 0u);
  EXPECT_EQ(tries, 1) << "not again within the first second";
  EXPECT_NE(port.reason(), "");
}

TEST_F(SerialFramePortTest, WhatCameBeforeTheUnpluggingIsStillRead) {
  SerialFramePort port(modem_.name(), 9600, 3600);
  Bytes line = encoded({1});
  for (const Bytes& frame : {Bytes{2}, Bytes{3}}) {
    const Bytes part = encoded(frame);
    line.insert(line.end(), part.begin(), part.end());
  }
  write(line);
  EXPECT_EQ(receiveOne(port), Bytes{1});
  modem_.unplug();
  EXPECT_EQ(receiveOne(port), Bytes{2});
  EXPECT_EQ(receiveOne(port), Bytes{3});
}

TEST_F(SerialFramePortTest, AModemThatGoesAwayIsSilence) {
  SerialFramePort port(modem_.name(), 9600);
  modem_.unplug();
  Bytes buffer(FramePort::kMaxFrameBytes);
  EXPECT_EQ(port.receive(buffer), 0u);
  (void)port.send(Bytes{1});
  EXPECT_FALSE(port.send(Bytes{1}));
}

}  // namespace
}  // namespace fathom::io
