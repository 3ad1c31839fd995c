#include "telemetry/wire/packet_log.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "realtime/base/input_error.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::telemetry {
namespace {

TEST(PacketLog, RoundTripsFramesAndTimes) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "packets.bin";
  {
    std::ofstream stream(path, std::ios::binary);
    for (int n = 1; n <= 256; n += 51)
      ASSERT_TRUE(writePacket(stream, -5 + n, std::vector<std::uint8_t>(static_cast<std::size_t>(n), 0xAB)));
  }
  PacketLogReader reader(path);
  for (int n = 1; n <= 256; n += 51) {
    const auto packet = reader.next();
    ASSERT_TRUE(packet);
    EXPECT_EQ(packet->utc_ns, -5 + n);
    EXPECT_EQ(packet->bytes, std::vector<std::uint8_t>(static_cast<std::size_t>(n), 0xAB));
  }
  EXPECT_FALSE(reader.next());
}

TEST(PacketLog, TruncatedAtAnyByteGivesTheWholePacketsThenOneClearError) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "packets.bin";
  std::ostringstream stream;
  for (int n = 0; n < 3; ++n) ASSERT_TRUE(writePacket(stream, n, std::vector<std::uint8_t>(20, 1)));
  const std::string whole = stream.str();
  for (std::size_t n = 0; n <= whole.size(); ++n) {
    test::writeText(path, whole.substr(0, n));
    PacketLogReader reader(path);
    std::size_t packets = 0;
    try {
      while (reader.next()) ++packets;
      EXPECT_EQ(n % 32, 0U);
    } catch (const InputError& error) {
      EXPECT_NE(n % 32, 0U);
      EXPECT_NE(std::string(error.what()).find("byte " + std::to_string(n / 32 * 32)), std::string::npos);
    }
    EXPECT_EQ(packets, n / 32);
  }
}

TEST(PacketLog, RefusesLengthsThatNoFrameHas) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "packets.bin";
  for (const char* head : {"\0\0\0\0", "\1\10\0\0", "\377\377\377\377"}) {
    test::writeText(path, std::string(head, 4) + std::string(2100, 'x'));
    PacketLogReader reader(path);
    EXPECT_THROW((void)reader.next(), InputError);
  }
  EXPECT_THROW(PacketLogReader(folder.path() / "absent.bin"), InputError);
  EXPECT_THROW(PacketLogReader(folder.path()), InputError);
}

}  // namespace
}  // namespace fathom::telemetry
