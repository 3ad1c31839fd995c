#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <vector>

#include "firmware_if/devices/can/n2k_definitions.hpp"
#include "firmware_if/devices/capture_commands.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::io {
namespace {

using Bytes = std::vector<std::uint8_t>;

CanFrame frameOf(std::uint32_t pgn, std::uint8_t source, const Bytes& bytes) {
  CanFrame frame{
      .utc_ns = {}, .id = (2U << 26) | (pgn << 8) | source, .size = static_cast<std::uint8_t>(bytes.size())};
  std::copy(bytes.begin(), bytes.end(), frame.data.begin());
  return frame;
}

N2kMessage decode(std::uint32_t pgn, const Bytes& payload) {
  N2kMessage message;
  EXPECT_TRUE(decodeN2kPayload(pgn, payload, message));
  return message;
}

// The frames of a fast packet.
std::vector<CanFrame> split(std::uint32_t pgn, std::uint8_t source, int sequence, const Bytes& payload) {
  std::vector<CanFrame> frames;
  std::size_t at = 0;
  for (std::uint8_t index = 0; at < payload.size(); ++index) {
    Bytes bytes = {static_cast<std::uint8_t>((sequence << 5) | index)};
    if (index == 0) bytes.push_back(static_cast<std::uint8_t>(payload.size()));
    while (bytes.size() < 8) bytes.push_back(at < payload.size() ? payload[at] : std::uint8_t{0xFF}), ++at;
    frames.push_back(frameOf(pgn, source, bytes));
  }
  return frames;
}

Bytes counting(std::size_t size) {
  Bytes out(size);
  for (std::size_t i = 0; i < size; ++i) out[i] = static_cast<std::uint8_t>(i);
  return out;
}

TEST(N2kId, BroadcastNumbersHoldTheSpecificFieldAndAddressedOnesDoNot) {
  const N2kId heading = parseN2kId(0x09F112CC);
  EXPECT_EQ(heading.pgn, 127250U);
  EXPECT_EQ(heading.source, 204);
  EXPECT_EQ(heading.destination, 255);
  EXPECT_EQ(heading.priority, 2);
  const N2kId request = parseN2kId(0x18EACCAC);
  EXPECT_EQ(request.pgn, 59904U);
  EXPECT_EQ(request.source, 172);
  EXPECT_EQ(request.destination, 204);
}

TEST(FastPacket, PacketsOfEverySizeComeOutAsTheyWereSplit) {
  for (const std::size_t size : {1U, 6U, 7U, 13U, 14U, 100U, 222U, 223U}) {
    FastPacketAssembler assembler;
    const Bytes payload = counting(size);
    const auto frames = split(129029, 1, 3, payload);
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const auto packet = assembler.add(parseN2kId(frames[i].id), frames[i]);
      if (i + 1 < frames.size()) {
        EXPECT_TRUE(packet.empty());
      } else {
        EXPECT_TRUE(std::ranges::equal(packet, payload)) << size;
      }
    }
    EXPECT_EQ(assembler.counts().complete, 1U);
    EXPECT_EQ(assembler.counts().incomplete, 0U);
  }
}

TEST(FastPacket, PacketsOfOtherSourcesGroupsAndSequencesMayInterleave) {
  FastPacketAssembler assembler;
  const std::vector<std::vector<CanFrame>> packets = {
      split(129029, 1, 0, counting(43)), split(129029, 2, 0, counting(43)), split(128275, 1, 0, counting(43)),
      split(129029, 1, 1, counting(43))};
  std::size_t complete = 0;
  for (std::size_t i = 0; i < packets[0].size(); ++i) {
    for (const auto& frames : packets) {
      if (!assembler.add(parseN2kId(frames[i].id), frames[i]).empty()) ++complete;
    }
  }
  EXPECT_EQ(complete, 4U);
}

TEST(FastPacket, ALostFrameLosesItsPacketAndNeverMixesItWithTheNext) {
  const auto old_packet = split(129029, 1, 5, Bytes(43, 0xAA));
  const auto new_packet = split(129029, 1, 5, Bytes(43, 0xBB));
  for (std::size_t lost = 0; lost < old_packet.size(); ++lost) {
    FastPacketAssembler assembler;
    std::vector<Bytes> out;
    const auto add = [&](const CanFrame& frame) {
      const auto packet = assembler.add(parseN2kId(frame.id), frame);
      if (!packet.empty()) out.emplace_back(packet.begin(), packet.end());
    };
    for (std::size_t i = 0; i < old_packet.size(); ++i) {
      if (i != lost) add(old_packet[i]);
    }
    for (const CanFrame& frame : new_packet) add(frame);
    ASSERT_EQ(out.size(), 1U) << "lost " << lost;
    EXPECT_EQ(out[0], Bytes(43, 0xBB));
    EXPECT_EQ(assembler.counts().incomplete + assembler.counts().orphans,
              lost == 0 ? old_packet.size() - 1 : 1U);
  }
}

TEST(FastPacket, AFrameZeroThatIsLostDoesNotFinishAnOlderPacket) {
  FastPacketAssembler assembler;
  const auto old_packet = split(129029, 1, 5, Bytes(43, 0xAA));
  const auto new_packet = split(129029, 1, 5, Bytes(43, 0xBB));
  // The old packet lacks its last frame; of the new one, frame 0 is lost.
  for (std::size_t i = 0; i + 1 < old_packet.size(); ++i)
    EXPECT_TRUE(assembler.add(parseN2kId(old_packet[i].id), old_packet[i]).empty());
  for (std::size_t i = 1; i < new_packet.size(); ++i)
    EXPECT_TRUE(assembler.add(parseN2kId(new_packet[i].id), new_packet[i]).empty());
  EXPECT_EQ(assembler.counts().incomplete, 1U);
}

TEST(FastPacket, APacketThatStopsIsGivenUpAfterItsTimeout) {
  FastPacketAssembler assembler;
  auto frames = split(129029, 1, 5, counting(20));
  frames[0].utc_ns = 1'000'000'000;
  frames[1].utc_ns = 1'700'000'000;
  frames[2].utc_ns = 2'500'000'000;  // 0.8 s later
  for (const CanFrame& frame : frames) EXPECT_TRUE(assembler.add(parseN2kId(frame.id), frame).empty());
  EXPECT_EQ(assembler.counts().incomplete, 1U);
  EXPECT_EQ(assembler.counts().orphans, 1U);
}

TEST(FastPacket, WhenAllSlotsAreBusyTheOldestIsDroppedAndCounted) {
  FastPacketAssembler assembler({.slots = 2});
  const auto a = split(129029, 1, 0, counting(10));
  const auto b = split(129029, 2, 0, counting(10));
  const auto c = split(129029, 3, 0, counting(10));
  for (const auto* packet : {&a, &b, &c})
    EXPECT_TRUE(assembler.add(parseN2kId((*packet)[0].id), (*packet)[0]).empty());
  EXPECT_EQ(assembler.counts().incomplete, 1U);
  EXPECT_TRUE(assembler.add(parseN2kId(a[1].id), a[1]).empty());
  EXPECT_FALSE(assembler.add(parseN2kId(b[1].id), b[1]).empty());
  EXPECT_FALSE(assembler.add(parseN2kId(c[1].id), c[1]).empty());
}

TEST(FastPacket, ImpossibleLengthsAndShortFramesAreBroken) {
  FastPacketAssembler assembler;
  const N2kId id{.priority = 2, .pgn = 129029, .source = 1, .destination = 255};
  EXPECT_TRUE(assembler.add(id, frameOf(129029, 1, {})).empty());
  EXPECT_TRUE(assembler.add(id, frameOf(129029, 1, {0x00, 0})).empty());
  EXPECT_TRUE(assembler.add(id, frameOf(129029, 1, {0x00, 224, 1, 2, 3, 4, 5, 6})).empty());
  EXPECT_TRUE(assembler.add(id, frameOf(129029, 1, {0x00, 20, 1, 2})).empty());
  EXPECT_EQ(assembler.counts().broken, 4U);
  EXPECT_EQ(assembler.counts().complete, 0U);
}

TEST(N2kDecoder, AWholeMessageIsDecodedAsItsFramesAre) {
  N2kDecoder decoder;
  N2kPacket packet{.utc_ns = 5, .id = {3, 129029, 36, 255}, .size = 43};
  ASSERT_NE(decoder.add(packet), nullptr);
  EXPECT_EQ(decoder.add(packet)->utc_ns, 5);
  EXPECT_EQ(decoder.add(packet)->id.source, 36);
  packet.id.pgn = 130823;
  EXPECT_EQ(decoder.add(packet), nullptr);
  EXPECT_EQ(decoder.counts().messages, 3U);
  EXPECT_EQ(decoder.counts().without_decoder, 1U);
}

TEST(N2kDecoder, HighestValuesOfAFieldAreAbsentAndTheOneBelowIsANumber) {
  // Heading: unsigned 16 bits from byte 1; 0xFFFF not available, 0xFFFE out of range, 0xFFFD reserved.
  for (const std::uint8_t low : {0xFF, 0xFE, 0xFD})
    EXPECT_FALSE(decode(127250, {0, low, 0xFF, 0xFF, 0x7F, 0xFF, 0x7F, 0xFF}).number("heading_rad"));
  EXPECT_DOUBLE_EQ(*decode(127250, {0, 0xFC, 0xFF, 0, 0, 0, 0, 0}).number("heading_rad"), 6.5532);
  // Yaw: signed 16 bits; the reserved values are the highest positive ones.
  for (const std::uint8_t low : {0xFF, 0xFE, 0xFD})
    EXPECT_FALSE(decode(127257, {0, low, 0x7F, 0, 0, 0, 0, 0}).number("yaw_rad"));
  EXPECT_DOUBLE_EQ(*decode(127257, {0, 0xFC, 0x7F, 0xFF, 0xFF, 0x00, 0x80, 0}).number("yaw_rad"), 3.2764);
  EXPECT_DOUBLE_EQ(*decode(127257, {0, 0xFC, 0x7F, 0xFF, 0xFF, 0x00, 0x80, 0}).number("pitch_rad"), -0.0001);
  EXPECT_DOUBLE_EQ(*decode(127257, {0, 0xFC, 0x7F, 0xFF, 0xFF, 0x00, 0x80, 0}).number("roll_rad"), -3.2768);
}

TEST(N2kDecoder, AMessageWithoutAnyValueHasNoFields) {
  for (const N2kPgnSpec& spec : n2kPgns()) {
    if (spec.pgn == 127508) continue;  // below
    Bytes unavailable(60, 0xFF);
    for (const N2kFieldSpec& field : spec.fields) {
      if (field.kind == N2kFieldKind::kSigned) unavailable[(field.bit + field.bits) / 8U - 1U] = 0x7F;
    }
    EXPECT_EQ(decode(spec.pgn, unavailable).field_count, 0U) << spec.pgn;
    EXPECT_EQ(decode(spec.pgn, {}).field_count, 0U) << spec.pgn;
    EXPECT_LE(spec.fields.size(), N2kMessage::kMaxFields) << spec.pgn;
  }
  EXPECT_EQ(decode(127508, {0xFF, 0xFF, 0x7F, 0xFF, 0x7F, 0xFF, 0xFF, 0xFF}).field_count, 0U);
}

TEST(N2kDecoder, AShortMessageGivesTheFieldsThatItHolds) {
  const N2kMessage message = decode(127257, {0, 0x10, 0x27, 0xF0, 0xD8});
  EXPECT_DOUBLE_EQ(*message.number("yaw_rad"), 1.0);
  EXPECT_DOUBLE_EQ(*message.number("pitch_rad"), -1.0);
  EXPECT_FALSE(message.number("roll_rad"));
}

TEST(N2kDecoder, AFieldSurveyVehiclesNeedIsReadInItsUnit) {
  // 20.5 bar absolute of water pressure: 2,050,000.0 Pa = 20,500,000 x 0.1 Pa = 0x0138CE20.
  const N2kMessage pressure = decode(130314, {1, 0, 1, 0x20, 0xCE, 0x38, 0x01, 0xFF});
  EXPECT_DOUBLE_EQ(*pressure.number("pressure_pa"), 2'050'000.0);
  EXPECT_EQ(std::string(pressure.present()[2].text), "water");
  // 12.34 V, -5.6 A, 298.15 K.
  const N2kMessage battery = decode(127508, {0, 0xD2, 0x04, 0xC8, 0xFF, 0x77, 0x74, 7});
  EXPECT_DOUBLE_EQ(*battery.number("voltage_v"), 12.34);
  EXPECT_DOUBLE_EQ(*battery.number("current_a"), -5.6);
  EXPECT_DOUBLE_EQ(*battery.number("temperature_c"), 25.0);
  // 283.456 K in 24 bits of millikelvin; 280.1 K in tenths.
  const N2kMessage water = decode(130316, {1, 0, 0, 0x40, 0x53, 0x04, 0xF1, 0x0A});
  EXPECT_NEAR(*water.number("temperature_c"), 10.306, 1e-12);
  EXPECT_NEAR(*water.number("set_temperature_c"), 6.95, 1e-12);
  EXPECT_NEAR(*decode(130312, {1, 0, 0, 0xBA, 0x6E, 0xFF, 0xFF, 0xFF}).number("temperature_c"), 10.31, 1e-12);
  // Speeds over water and ground, the stern's absent.
  const N2kMessage speed =
      decode(130578, {0xE8, 0x03, 0x18, 0xFC, 0x01, 0x00, 0xFF, 0xFF, 0xFF, 0x7F, 0xFF, 0x7F});
  EXPECT_DOUBLE_EQ(*speed.number("longitudinal_water_speed_mps"), 1.0);
  EXPECT_DOUBLE_EQ(*speed.number("transverse_water_speed_mps"), -1.0);
  EXPECT_DOUBLE_EQ(*speed.number("longitudinal_ground_speed_mps"), 0.001);
  EXPECT_DOUBLE_EQ(*speed.number("transverse_ground_speed_mps"), -0.001);
  EXPECT_FALSE(speed.number("stern_water_speed_mps"));
}

TEST(N2kDecoder, SalinityIsAFloatAndNotANumberIsAbsent) {
  Bytes station(22, 0xFF);
  const auto bits = std::bit_cast<std::array<std::uint8_t, 4>>(35.25F);
  std::copy(bits.begin(), bits.end(), station.begin() + 15);
  EXPECT_DOUBLE_EQ(*decode(130321, station).number("salinity_ppt"), 35.25);
  std::fill(station.begin() + 15, station.begin() + 19, std::uint8_t{0xFF});
  EXPECT_FALSE(decode(130321, station).number("salinity_ppt"));
}

TEST(N2kDecoder, DecodingFramesAllocatesNothing) {
  N2kDecoder decoder;
  const auto gnss = split(129029, 1, 2, counting(43));
  const CanFrame heading = frameOf(127250, 1, {0, 1, 2, 3, 4, 5, 6, 0xFD});
  const auto before = test::threadCost();
  for (int i = 0; i < 100; ++i) {
    (void)decoder.add(heading);
    for (const CanFrame& frame : gnss) (void)decoder.add(frame);
  }
  EXPECT_EQ(test::threadCost().heap_calls - before.heap_calls, 0U);
  EXPECT_EQ(decoder.counts().messages, 200U);
}

TEST(CanJson, NumbersReadBackExactlyAndAbsentOnesAreLeftOut) {
  N2kDecoder decoder;
  CanFrame frame = frameOf(129025, 43, {0xF1, 0x2B, 0x6B, 0x1B, 0x8E, 0x5E, 0x36, 0xFF});
  frame.utc_ns = 1'502'984'866'429'139'000;
  EXPECT_EQ(toJson(*decoder.add(frame)),
            R"({"time_s":1502984866.429139,"pgn":129025,"source":43,"fields":{"latitude_deg":46.0008433,)"
            R"("longitude_deg":-1.3214066}})");
  frame = frameOf(127250, 7, {0xFF, 0x72, 0x5A, 0xFF, 0x7F, 0x0C, 0xFE, 0xFD});
  EXPECT_EQ(toJson(*decoder.add(frame)),
            R"({"pgn":127250,"source":7,"fields":{"heading_rad":2.3154,"variation_rad":-0.05,)"
            R"("reference":"magnetic"}})");
}

}  // namespace
}  // namespace fathom::io
