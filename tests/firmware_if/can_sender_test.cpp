#include "firmware_if/devices/can/send/can_sender.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <set>
#include <vector>

#include "firmware_if/devices/can/can_text.hpp"
#include "firmware_if/devices/can/n2k_decoder.hpp"
#include "firmware_if/devices/can/send/n2k_encoder.hpp"
#include "realtime/base/units.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::io {
namespace {

using ::testing::ElementsAre;
using Bytes = std::vector<std::uint8_t>;

constexpr std::int64_t kStart_ns = 1'700'000'000 * kSecond_ns;

Bytes littleEndian(std::uint64_t value, std::size_t size) {
  Bytes out(size);
  for (std::uint8_t& byte : out) {
    byte = static_cast<std::uint8_t>(value);
    value >>= 8;
  }
  return out;
}

CanFrame addressedFrame(std::uint32_t pgn, std::uint8_t source, std::uint8_t destination,
                        const Bytes& bytes) {
  CanFrame frame{.utc_ns = {},
                 .id = makeN2kId({6, pgn, source, destination}),
                 .size = static_cast<std::uint8_t>(bytes.size())};
  std::ranges::copy(bytes, frame.data.begin());
  return frame;
}

// A sender on a bus that takes everything, and a clock.
class CanSenderTest : public ::testing::Test {
 protected:
  // Runs for a time in steps of 10 ms; what was sent.
  std::vector<CanFrame> run(CanSender& sender, double seconds) {
    std::vector<CanFrame> out;
    for (int i = 0; i < static_cast<int>(seconds * 100); ++i, now_ns_ += kSecond_ns / 100) {
      while (const CanFrame* frame = sender.next(now_ns_)) {
        out.push_back(*frame);
        out.back().utc_ns = now_ns_;
        sender.sent(now_ns_);
      }
    }
    return out;
  }
  void claimAddress(CanSender& sender) {
    sender.start();
    ASSERT_EQ(run(sender, 0.25).size(), 1U);
  }
  VehicleReport report() const {
    return VehicleReport{.utc_ns = now_ns_,
                         .latitude = -33.8568 * kRadiansPerDegree,
                         .longitude = 151.2153 * kRadiansPerDegree,
                         .sigma_horizontal = 0.35,
                         .depth = 12.345,
                         .altitude = 2.04,
                         .map_area = 1234.4,
                         .pairs_mapped = 70'000,
                         .pairs_dropped = 3,
                         .health = 0x0140,
                         .mission_progress = 0.25};
  }
  static std::vector<N2kMessage> decode(const std::vector<CanFrame>& frames) {
    N2kDecoder decoder;
    std::vector<N2kMessage> out;
    for (const CanFrame& frame : frames)
      if (const N2kMessage* message = decoder.add(frame)) out.push_back(*message);
    return out;
  }
  std::int64_t now_ns_ = kStart_ns;
};

TEST(N2kEncoder, FramesAreThoseThatARealCompassSent) {
  // A vessel heading of the reference capture: (1502984866.421964) slcan0 09F112CC#FF725AFF7FFF7FFD.
  Bytes payload(8);
  const std::array<N2kValue, 2> values = {{{"heading_rad", 2.3154}, {"reference", 1}}};
  ASSERT_TRUE(encodeN2kPayload(127250, values, payload));
  EXPECT_EQ(payload, (Bytes{0xFF, 0x72, 0x5A, 0xFF, 0x7F, 0xFF, 0x7F, 0xFD}));
  EXPECT_EQ(makeN2kId({2, 127250, 204, kEveryone}), 0x09F112CCU);
  EXPECT_EQ(makeN2kId({6, kRequestPgn, 172, 204}), 0x18EACCACU);
}

TEST(N2kEncoder, ValuesThatAFieldCannotHoldAreNotAvailable) {
  Bytes payload(8);
  N2kMessage message;
  // The offset's field ends at 32.764 m.
  const std::array<N2kValue, 2> deep = {{{"depth_m", std::nan("")}, {"offset_m", 32.765}}};
  ASSERT_TRUE(encodeN2kPayload(128267, deep, payload));
  ASSERT_TRUE(decodeN2kPayload(128267, payload, message));
  EXPECT_EQ(message.field_count, 0U);
  const std::array<N2kValue, 1> fits = {{{"offset_m", -32.768 + 0.001}}};
  ASSERT_TRUE(encodeN2kPayload(128267, fits, payload));
  ASSERT_TRUE(decodeN2kPayload(128267, payload, message));
  EXPECT_EQ(message.number("offset_m"), -32.767);
}

TEST(N2kEncoder, RefusesFieldsAndGroupsThatItDoesNotKnow) {
  Bytes payload(8), small(2);
  const std::array<N2kValue, 1> speed = {{{"speed", 1}}}, depth = {{{"depth_m", 1}}};
  EXPECT_FALSE(encodeN2kPayload(128267, speed, payload));
  EXPECT_FALSE(encodeN2kPayload(128267, depth, small));
  EXPECT_FALSE(encodeN2kPayload(1, {}, payload));
}

TEST(N2kEncoder, FastPacketsOfEveryLengthComeTogetherAgain) {
  FastPacketAssembler assembler;
  std::array<CanFrame, kMaxFastPacketFrames> frames;
  for (std::size_t size = 1; size <= FastPacketAssembler::kMaxBytes; ++size) {
    Bytes payload(size);
    for (std::size_t i = 0; i < size; ++i) payload[i] = static_cast<std::uint8_t>(i * 7);
    const N2kId id{3, 129029, 9, kEveryone};
    const std::size_t count = splitFastPacket(id, static_cast<unsigned>(size), payload, frames);
    Bytes got;
    for (std::size_t i = 0; i < count; ++i) {
      const auto whole = assembler.add(id, frames[i]);
      got.assign(whole.begin(), whole.end());
    }
    EXPECT_EQ(got, payload);
  }
}

TEST_F(CanSenderTest, PositionDepthAndMapStatusSayWhatTheReportSays) {
  CanSender sender({});
  claimAddress(sender);
  sender.publish(report());
  const std::vector<CanFrame> frames = run(sender, 0.2);
  bool rapid = false, fix = false, depth = false;
  for (const N2kMessage& m : decode(frames)) {
    EXPECT_EQ(m.id.source, 120);
    if (m.id.pgn == 129025) {
      rapid = true;
      EXPECT_NEAR(*m.number("latitude_deg"), -33.8568, 1e-7);
      EXPECT_NEAR(*m.number("longitude_deg"), 151.2153, 1e-7);
    } else if (m.id.pgn == 129029) {
      fix = true;
      EXPECT_NEAR(*m.number("latitude_deg"), -33.8568, 1e-12);
      EXPECT_NEAR(*m.number("longitude_deg"), 151.2153, 1e-12);
      EXPECT_EQ(m.number("method"), 6);  // estimated
      EXPECT_EQ(m.number("satellites"), 0);
      EXPECT_EQ(m.number("hdop"), std::nullopt);
      EXPECT_EQ(m.number("days_since_1970"), kStart_ns / kSecond_ns / 86400);
      EXPECT_NEAR(*m.number("time_of_day_s"), 1'700'000'000 % 86400 + 0.25, 1e-4);
    } else if (m.id.pgn == 128267) {
      depth = true;
      EXPECT_NEAR(*m.number("depth_m"), 2.04, 1e-9);
      EXPECT_NEAR(*m.number("offset_m"), 12.345, 1e-9);
    }
  }
  EXPECT_TRUE(rapid && fix && depth);
  Bytes status;
  FastPacketAssembler assembler;
  for (const CanFrame& frame : frames) {
    const N2kId id = parseN2kId(frame.id);
    if (id.pgn != 130900) continue;
    const auto whole = assembler.add(id, frame);
    status.assign(whole.begin(), whole.end());
  }
  // As the header lays it out: 2046 and marine, version 1, 25 %, 1234 m2, 70,000 and 3 pairs, health, 35 cm.
  EXPECT_THAT(status, ElementsAre(0xFE, 0x9F, 1, 50, 0xD2, 0x04, 0, 0, 0x70, 0x11, 0x01, 0, 3, 0, 0, 0, 0x40,
                                  0x01, 35, 0));
}

TEST_F(CanSenderTest, WhatIsUnknownIsNotSentAsANumber) {
  CanSender sender({});
  claimAddress(sender);
  VehicleReport unknown;
  unknown.utc_ns = now_ns_;
  unknown.altitude = 2;
  sender.publish(unknown);
  const auto frames = run(sender, 0.2);
  for (const N2kMessage& m : decode(frames)) {
    EXPECT_EQ(m.id.pgn, 128267U);
    EXPECT_EQ(m.number("offset_m"), std::nullopt);
  }
}

TEST_F(CanSenderTest, AnOldReportIsNotSentOn) {
  CanSender sender({});
  claimAddress(sender);
  sender.publish(report());
  run(sender, 3.1);
  for (const CanFrame& frame : run(sender, 30)) EXPECT_EQ(parseN2kId(frame.id).pgn, 126993U);
}

TEST_F(CanSenderTest, OnlyWhatTellsEverLeaves) {
  CanSender::Config config;
  config.software_version = std::string(50, 'v');
  CanSender sender(config);
  claimAddress(sender);
  const std::set<std::uint32_t> allowed(CanSender::kSentPgns.begin(), CanSender::kSentPgns.end());
  std::set<std::uint32_t> sent;
  for (std::uint32_t pgn = 0; pgn < 0x20000; pgn += pgn < 59000 || pgn > 61000 ? 97 : 1) {
    Bytes asked = littleEndian(pgn, 3);
    sender.receive(addressedFrame(kRequestPgn, 7, pgn % 2 == 0 ? 120 : kEveryone, asked), now_ns_);
    sender.publish(report());
    for (const CanFrame& frame : run(sender, 0.02)) sent.insert(parseN2kId(frame.id).pgn);
  }
  for (const std::uint32_t pgn : {126464U, 126996U}) {
    sender.receive(addressedFrame(kRequestPgn, 7, 120, littleEndian(pgn, 3)), now_ns_);
    for (const CanFrame& frame : run(sender, 1)) sent.insert(parseN2kId(frame.id).pgn);
  }
  sent.erase(config.status_pgn);
  EXPECT_EQ(sent, allowed);
}

TEST_F(CanSenderTest, ProductInformationIsSentWhenAskedFor) {
  CanSender::Config config;
  config.software_version = "1.2.3";
  CanSender sender(config);
  claimAddress(sender);
  run(sender, 1);
  sender.receive(addressedFrame(kRequestPgn, 7, kEveryone, littleEndian(126996, 3)), now_ns_);
  FastPacketAssembler assembler;
  Bytes product;
  for (const CanFrame& frame : run(sender, 1)) {
    const auto whole = assembler.add(parseN2kId(frame.id), frame);
    product.assign(whole.begin(), whole.end());
  }
  ASSERT_EQ(product.size(), 134U);
  EXPECT_EQ(std::string(product.begin() + 4, product.begin() + 10), "Fathom");
  EXPECT_EQ(std::string(product.begin() + 36, product.begin() + 41), "1.2.3");
  EXPECT_EQ(product[41], 0xFF);
}

TEST_F(CanSenderTest, ARequestThatCannotBeMetIsRefusedOnlyWhenItIsForUs) {
  CanSender sender({});
  claimAddress(sender);
  run(sender, 1);
  sender.receive(addressedFrame(kRequestPgn, 7, kEveryone, littleEndian(126998, 3)), now_ns_);
  sender.receive(addressedFrame(kRequestPgn, 7, 121, littleEndian(126998, 3)), now_ns_);
  EXPECT_EQ(run(sender, 0.1).size(), 0U);
  sender.receive(addressedFrame(kRequestPgn, 7, 120, littleEndian(126998, 3)), now_ns_);
  const auto frames = run(sender, 0.1);
  ASSERT_EQ(frames.size(), 1U);
  EXPECT_EQ(frames[0].id, makeN2kId({6, 59392, 120, 7}));
  EXPECT_THAT(Bytes(frames[0].data.begin(), frames[0].data.end()),
              ElementsAre(1, 0xFF, 0xFF, 0xFF, 0xFF, 0x16, 0xF0, 0x01));
}

TEST_F(CanSenderTest, NothingButTheClaimLeavesBeforeTheAddressIsHeld) {
  CanSender sender({});
  sender.start();
  sender.publish(report());
  const auto frames = run(sender, 0.24);
  ASSERT_EQ(frames.size(), 1U);
  // NAME 1 (unique number), 2046, instance 0, function 175, class 60, marine, arbitrary address.
  EXPECT_EQ(frames[0].id, 0x18EEFF78U);
  EXPECT_THAT(Bytes(frames[0].data.begin(), frames[0].data.end()),
              ElementsAre(1, 0, 0xC0, 0xFF, 0, 175, 120, 0xC0));
  EXPECT_GT(run(sender, 0.2).size(), 0U);
}

TEST_F(CanSenderTest, ALowerNameTakesTheAddressAndAHigherOneDoesNot) {
  CanSender sender({});
  claimAddress(sender);
  sender.publish(report());
  run(sender, 0.1);
  // A higher NAME: the claim is sent again, and sending continues.
  sender.receive(addressedFrame(kAddressClaimPgn, 120, kEveryone, littleEndian(~0ULL, 8)), now_ns_);
  auto frames = run(sender, 0.05);
  ASSERT_GE(frames.size(), 1U);
  EXPECT_EQ(frames[0].id, 0x18EEFF78U);
  EXPECT_EQ(sender.claim().lost(), 0U);
  // Somebody at the next address; then a lower NAME claims ours: the one after that is claimed.
  sender.receive(addressedFrame(126993, 121, kEveryone, Bytes(8)), now_ns_);
  sender.receive(addressedFrame(kAddressClaimPgn, 120, kEveryone, littleEndian(5, 8)), now_ns_);
  frames = run(sender, 0.24);
  ASSERT_EQ(frames.size(), 1U);
  EXPECT_EQ(frames[0].id, 0x18EEFF7AU);
  EXPECT_EQ(sender.claim().lost(), 1U);
  sender.publish(report());
  frames = run(sender, 2);
  ASSERT_GT(frames.size(), 0U);
  for (const CanFrame& frame : frames) EXPECT_EQ(parseN2kId(frame.id).source, 122);
}

TEST_F(CanSenderTest, ADeviceWithoutAnAddressSaysSoAndIsSilent) {
  CanSender sender({});
  claimAddress(sender);
  std::size_t claims = 0;
  // A bus that takes every address from us.
  for (int i = 0; i < 300; ++i) {
    sender.receive(addressedFrame(kAddressClaimPgn, sender.claim().address(), kEveryone, littleEndian(1, 8)),
                   now_ns_);
    for (const CanFrame& frame : run(sender, 0.02))
      claims += parseN2kId(frame.id).pgn == kAddressClaimPgn ? 1U : 0U;
  }
  EXPECT_EQ(sender.claim().address(), kNoAddress);
  EXPECT_LE(claims, 253U);
  sender.publish(report());
  EXPECT_EQ(run(sender, 2).size(), 0U);
  sender.receive(addressedFrame(kRequestPgn, 7, kEveryone, littleEndian(kAddressClaimPgn, 3)), now_ns_);
  const auto frames = run(sender, 1);
  ASSERT_EQ(frames.size(), 1U);
  EXPECT_EQ(frames[0].id, 0x18EEFFFEU);
}

TEST_F(CanSenderTest, TheRateIsBounded) {
  CanSender::Config config;
  config.position_period_s = config.depth_period_s = config.fix_period_s = config.status_period_s = 0.1;
  config.frames_per_s = 20;
  CanSender sender(config);
  claimAddress(sender);
  std::size_t count = 0;
  for (int i = 0; i < 100; ++i) {
    sender.publish(report());
    sender.receive(addressedFrame(kRequestPgn, 7, 120, littleEndian(126996, 3)), now_ns_);
    count += run(sender, 0.1).size();
  }
  EXPECT_LE(count, 20U * 10 + 41);
  EXPECT_GE(count, 20U * 10 - 5);
  EXPECT_GT(sender.counts().dropped, 0U);
}

TEST_F(CanSenderTest, FramesThatTheBusDoesNotTakeGrowOldAndAreDropped) {
  CanSender sender({});
  claimAddress(sender);
  for (int i = 0; i < 500; ++i, now_ns_ += kSecond_ns / 10) {
    sender.publish(report());
    static_cast<void>(sender.next(now_ns_));  // never sent
  }
  EXPECT_GT(sender.counts().dropped, 50U);
  // The bus is back: what leaves is young.
  sender.publish(report());
  const auto messages = decode(run(sender, 0.1));
  ASSERT_GT(messages.size(), 0U);
  for (const N2kMessage& m : messages)
    if (m.id.pgn == 129029) {
      EXPECT_GT(*m.number("time_of_day_s"), static_cast<double>((now_ns_ / kSecond_ns - 3) % 86400));
    }
}

TEST_F(CanSenderTest, TakesNoMemory) {
  CanSender sender({});
  claimAddress(sender);
  const CanFrame request = addressedFrame(kRequestPgn, 7, 120, littleEndian(126996, 3));
  const VehicleReport now = report();
  const auto before = rt::threadCost();
  for (int i = 0; i < 1000; ++i, now_ns_ += kSecond_ns / 100) {
    sender.publish(now);
    sender.receive(request, now_ns_);
    while (sender.next(now_ns_) != nullptr) sender.sent(now_ns_);
  }
  EXPECT_EQ((rt::threadCost() - before).heap_calls, 0U);
}

}  // namespace
}  // namespace fathom::io
