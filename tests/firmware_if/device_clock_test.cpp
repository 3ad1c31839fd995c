#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <sys/socket.h>
#include "firmware_if/devices/vehicle_time.hpp"
#include "realtime/base/units.hpp"

#include <random>

#include "firmware_if/devices/byte_stream.hpp"
#include "firmware_if/devices/device_address.hpp"
#include "firmware_if/devices/modem/modem_ports.hpp"
#include "firmware_if/devices/serial/serial_line.hpp"
#include "firmware_if/devices/udp_socket.hpp"
#include "realtime/base/units.hpp"
#include "tests/support/pty_line.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

using test::refusal, ::testing::HasSubstr;

constexpr std::int64_t kFirstStamp_ns = 1'700'000'000 * kSecond_ns;  // vehicle time

std::int64_t ns(double seconds) {
  return std::llround(seconds * 1e9);
}

// A device with a clock that is `offset_s` off and drifts, seven messages a second; they arrive late by a
// least delay and noise that only ever adds.
struct Device {
  double offset_s = -3600, ppm = 0, latency_s = 0.05, noise_s = 0.03;
  std::mt19937 random{7};
  std::int64_t stamp(double t) const {
    // As a DVL sends it: hundredths of a second, cut.
    const std::int64_t exact = kFirstStamp_ns + ns(t * (1 + ppm * 1e-6) + offset_s);
    return exact - exact % (kSecond_ns / 100);
  }
  std::int64_t arrival(double t) {
    return kFirstStamp_ns + ns(t + latency_s + std::exponential_distribution<double>(1 / noise_s)(random));
  }
};

TEST(DeviceClock, OffsetAndDriftOfAQuartzAreFollowedForHours) {
  for (const double ppm : {-100.0, 0.0, 100.0}) {
    Device device{.ppm = ppm};
    DeviceClock clock({.latency_s = device.latency_s, .resolution_s = 0.01});
    double worst = 0, worst_step = 0, sum = 0, count = 0;
    std::int64_t before = 0;
    for (int i = 0; i < 7 * 3600 * 3; ++i) {
      const double t = i / 7.0;
      const std::int64_t arrival = device.arrival(t);
      const std::int64_t utc = clock.vehicleNs(device.stamp(t), arrival);
      EXPECT_LE(utc, arrival);
      if (t < 60) continue;
      const double error = static_cast<double>(utc - kFirstStamp_ns) / 1e9 - t;
      sum += error;
      ++count;
      worst = std::max(worst, std::abs(error));
      if (before != 0)
        worst_step = std::max(worst_step, std::abs(static_cast<double>(utc - before) / 1e9 - 1 / 7.0));
      before = utc;
    }
    EXPECT_LT(worst, 0.011) << ppm << " ppm: the stamps alone are cut to 0.01 s";
    EXPECT_NEAR(sum / count, 0, 0.005) << "what is left of the noise in a window's least";
    EXPECT_LT(worst_step, 0.02);
    // A clock that runs fast needs less and less to be added.
    EXPECT_NEAR(clock.rate() * 1e6, -ppm, 12);
    EXPECT_EQ(clock.leaps(), 0u);
    EXPECT_LT(clock.late(), 40u) << "one in 4000 of these";
    EXPECT_NEAR(clock.offset(), 3600 - 10800 * ppm * 1e-6, 0.02);
  }
}

TEST(DeviceClock, AStepOfTheClockIsNoticedInBothDirections) {
  for (const double leap : {-37.0, -2.0, 0.5, 37.0}) {
    Device device;
    DeviceClock clock({.latency_s = device.latency_s, .resolution_s = 0.01});
    double t = 0;
    for (; t < 60; t += 1 / 7.0) (void)clock.vehicleNs(device.stamp(t), device.arrival(t));
    device.offset_s += leap;
    for (int i = 0; t < 120; t += 1 / 7.0, ++i) {
      const std::int64_t arrival = device.arrival(t);
      const double utc =
          static_cast<double>(clock.vehicleNs(device.stamp(t), arrival) - kFirstStamp_ns) / 1e9;
      // Stamped by arrival for a moment, then by the clock again; never by the wrong time.
      EXPECT_LE(std::abs(utc - t), i < 40 ? 0.26 : 0.02) << "leap " << leap << ", message " << i;
    }
    EXPECT_EQ(clock.leaps(), 1u) << leap;
  }
}

TEST(DeviceClock, AMessageThatWasHeldUpMovesNothing) {
  Device device{.noise_s = 0.002};
  DeviceClock clock({.latency_s = device.latency_s, .resolution_s = 0.01});
  for (int i = 0; i < 700; ++i) {
    const double t = i / 7.0;
    std::int64_t arrival = device.arrival(t);
    const bool held_up = i % 50 == 49;
    if (held_up) arrival += ns(0.2 + 0.02 * (i % 7));
    const double utc = static_cast<double>(clock.vehicleNs(device.stamp(t), arrival) - kFirstStamp_ns) / 1e9;
    if (i > 20 && !held_up) {
      EXPECT_NEAR(utc, t, 0.015);
    }
  }
  EXPECT_EQ(clock.leaps(), 0u);
}

TEST(DeviceClock, SameCallsSameResult) {
  Device a, b;
  DeviceClock first({}), second({});
  for (int i = 0; i < 1000; ++i)
    EXPECT_EQ(first.vehicleNs(a.stamp(i / 7.0), a.arrival(i / 7.0)),
              second.vehicleNs(b.stamp(i / 7.0), b.arrival(i / 7.0)));
}

using Bytes = std::vector<std::uint8_t>;

TEST(DeviceAddress, EachKindIsReadWhole) {
  std::string fix;
  const auto serial = parseDeviceAddress("serial:/dev/serial/by-id/usb-FTDI:0:115200", fix);
  ASSERT_TRUE(serial);
  EXPECT_EQ(serial->kind, DeviceAddress::Kind::kSerial);
  EXPECT_EQ(serial->name, "/dev/serial/by-id/usb-FTDI:0") << "names may hold colons";
  EXPECT_EQ(serial->number, 115200);
  const auto udp = parseDeviceAddress("udp:127.0.0.1:14700", fix);
  ASSERT_TRUE(udp);
  EXPECT_EQ(udp->kind, DeviceAddress::Kind::kUdp);
  EXPECT_EQ(udp->number, 14700);
  const auto file = parseDeviceAddress("file:/data/a:b.pd0", fix);
  ASSERT_TRUE(file);
  EXPECT_EQ(file->name, "/data/a:b.pd0");
}

TEST(DeviceAddress, NonsenseIsRefusedWithTheFix) {
  const std::vector<std::pair<std::string, std::string>> bad = {
      {"", "give udp:HOST:PORT"},
      {"ttyS1", "give udp:HOST:PORT"},
      {"serial:/dev/ttyS1", "give udp:HOST:PORT"},
      {"serial::9600", "give udp:HOST:PORT"},
      {"usb:1:2", "unknown kind"},
      {"serial:/dev/ttyS1:fast", "must be a number"},
      {"serial:/dev/ttyS1:", "must be a number"},
      {"serial:/dev/ttyS1:9600 ", "must be a number"},
      {"udp:127.0.0.1:0", "1 to 65535"},
      {"udp:127.0.0.1:65536", "1 to 65535"},
      {"udp:127.0.0.1:99999999999", "must be a number"},
      {"file:", "name the file"}};
  for (const auto& refused : bad) {
    const std::string text = refused.first, expected = refused.second;
    std::string fix;
    EXPECT_FALSE(parseDeviceAddress(text, fix)) << text;
    EXPECT_THAT(fix, HasSubstr(expected)) << text;
    EXPECT_THAT(refusal([&] { (void)openFramePort(text, "--modem " + text); }), HasSubstr("--modem " + text))
        << text;
  }
  EXPECT_THAT(refusal([] { (void)openFramePort("file:/x", "--modem"); }), HasSubstr("a modem is no file"));
  EXPECT_THAT(refusal([] { (void)openFramePort("serial:/dev/ttyS1:9601", "--modem"); }),
              HasSubstr("9601 baud is not one of"));
  EXPECT_THAT(refusal([] { (void)openFramePort("udp:ship:9000", "--modem"); }),
              HasSubstr("ship is no IPv4 address"));
}

TEST(DeviceAddress, AModemThatIsNotThereIsWaitedFor) {
  const test::TemporaryFolder folder;
  const auto port = openFramePort("serial:" + (folder.path() / "modem").string() + ":9600", "--modem");
  EXPECT_FALSE(port->isOpen());
  EXPECT_THAT(std::string(port->reason()), HasSubstr("cannot be opened (No such file or directory)"));
  EXPECT_FALSE(port->send(Bytes{1}));
}

TEST(SerialLine, ASecondUserIsRefusedUntilTheFirstHasGone) {
  const test::PtyLine line;
  {
    const SerialLine first(line.name(), 9600, SerialLine::IfAbsent::kRefuse);
    EXPECT_THAT(refusal([&] { SerialLine second(line.name(), 9600, SerialLine::IfAbsent::kRefuse); }),
                HasSubstr("is in use by another program"));
    const SerialLine waiting(line.name(), 9600, SerialLine::IfAbsent::kWait);
    EXPECT_FALSE(waiting.isOpen());
  }
  const SerialLine after(line.name(), 9600, SerialLine::IfAbsent::kRefuse);
  EXPECT_TRUE(after.isOpen());
}

TEST(SerialLine, ALineThatIsNotThereYetIsOpenedWhenItComes) {
  test::PtyLine line;
  line.unplug();
  SerialLine serial(line.name(), 115200, SerialLine::IfAbsent::kWait, 0);
  Bytes buffer(16);
  EXPECT_EQ(serial.read(buffer, 1), 0u);
  EXPECT_FALSE(serial.isOpen());
  line.plug();
  line.send(Bytes{1, 2, 3});
  EXPECT_EQ(serial.read(buffer, 1000), 3u);
  EXPECT_EQ(serial.connections(), 1u);
  EXPECT_EQ(serial.disconnects(), 0u);
  EXPECT_EQ(serial.write(Bytes{9}), 1u);
}

TEST(SerialLine, AnAbsentLineIsTriedAtMostOnceAnInterval) {
  test::PtyLine line;
  SerialLine serial(line.name(), 115200, SerialLine::IfAbsent::kRefuse, 3600);
  line.unplug();
  Bytes buffer(16);
  EXPECT_EQ(serial.read(buffer, 0), 0u);
  EXPECT_EQ(serial.read(buffer, 0), 0u);
  line.plug();
  for (int i = 0; i < 3; ++i) EXPECT_EQ(serial.read(buffer, 0), 0u);
  EXPECT_FALSE(serial.isOpen());
  EXPECT_EQ(serial.disconnects(), 1u);
}

TEST(UdpStream, DatagramsAreReadInTheirOrderPieceByPiece) {
  UdpStream stream("127.0.0.1", 0);
  Bytes buffer(4);
  EXPECT_EQ(stream.read(buffer, 0), 0u);
  const int sender = ::socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in to = {};
  to.sin_family = AF_INET;
  to.sin_port = htons(stream.port());
  ::inet_pton(AF_INET, "127.0.0.1", &to.sin_addr);
  for (const Bytes& datagram : {Bytes{1, 2, 3, 4, 5, 6}, Bytes{7}})
    ASSERT_EQ(
        ::sendto(sender, datagram.data(), datagram.size(), 0, reinterpret_cast<sockaddr*>(&to), sizeof to),
        static_cast<ssize_t>(datagram.size()));
  ::close(sender);
  Bytes all;
  for (int i = 0; i < 10 && all.size() < 7; ++i) {
    const std::size_t n = stream.read(buffer, 100);
    all.insert(all.end(), buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(n));
  }
  EXPECT_EQ(all, (Bytes{1, 2, 3, 4, 5, 6, 7}));
  EXPECT_THAT(refusal([] { UdpStream none("dvl", 1); }), HasSubstr("is no IPv4 address"));
}

TEST(UdpStream, APortThatIsTakenIsListenedOnWhenItIsFree) {
  auto first = std::make_unique<UdpStream>("127.0.0.1", 0);
  UdpStream second("127.0.0.1", first->port(), 0);
  Bytes buffer(4);
  EXPECT_EQ(second.read(buffer, 0), 0u);
  EXPECT_FALSE(second.isOpen());
  EXPECT_EQ(second.reason(), "Address already in use");
  UdpStream patient("127.0.0.1", first->port(), 3'600'000'000'000);
  first.reset();
  EXPECT_EQ(second.read(buffer, 0), 0u);
  EXPECT_TRUE(second.isOpen());
  EXPECT_EQ(second.reason(), "");
  EXPECT_EQ(patient.read(buffer, 0), 0u);
  EXPECT_FALSE(patient.isOpen()) << "it is not yet time";
}

TEST(UdpStream, AnAddressThatNoInterfaceHasYetIsWaitedFor) {
  const UdpStream stream("192.0.2.1", 9);
  EXPECT_FALSE(stream.isOpen());
  EXPECT_EQ(stream.reason(), "Cannot assign requested address");
}

TEST(FileStream, GivesItsBytesAndIsClosedAtTheEnd) {
  const test::TemporaryFolder folder;
  const std::string path = (folder.path() / "capture").string();
  test::writeText(path, "abcdef");
  FileStream stream(path);
  Bytes buffer(4);
  EXPECT_EQ(stream.read(buffer, 0), 4u);
  EXPECT_EQ(stream.read(buffer, 0), 2u);
  EXPECT_TRUE(stream.isOpen());
  EXPECT_EQ(stream.read(buffer, 0), 0u);
  EXPECT_FALSE(stream.isOpen());
  EXPECT_THAT(refusal([] { FileStream none("/absent"); }), HasSubstr("/absent: cannot be read"));
  EXPECT_THAT(refusal([&] { FileStream none(folder.path().string()); }), HasSubstr("is no file of bytes"));
}

}  // namespace
}  // namespace fathom::io
