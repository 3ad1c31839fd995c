#include "telemetry/ship/ship_link.hpp"

#include <gtest/gtest.h>

#include <array>
#include <vector>

namespace fathom::telemetry {
namespace {

constexpr LinkIdentity kIdentity{3, 17};
constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::int64_t kStart_ns = 1'790'000'000 * kSecond_ns;
using Bytes = std::vector<std::uint8_t>;

Bytes uplink(std::uint16_t sequence, bool turn) {
  FrameHeader header;
  header.identity = kIdentity;
  header.version = sequence;
  header.type = MessageType::kTrack;
  header.turn = turn;
  std::array<std::uint8_t, kMaxFrameBytes> buffer{};
  const std::array<std::uint8_t, 4> payload = {1, 2, 3, 4};
  const std::size_t size = encodeFrame(header, payload, buffer);
  return {buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(size)};
}

class ShipLinkTest : public ::testing::Test {
 protected:
  FrameVerdict hear(double seconds, const Bytes& frame) {
    return ship_.accept(at(seconds), frame, [](const auto&) { return true; }).verdict;
  }
  std::size_t speak(double seconds) { return ship_.nextFrame(at(seconds), out_); }
  static std::int64_t at(double seconds) { return kStart_ns + static_cast<std::int64_t>(seconds * 1e9); }

  ShipLink ship_{std::nullopt, std::nullopt};
  std::array<std::uint8_t, kMaxFrameBytes> out_{};
};

TEST_F(ShipLinkTest, TheShipSpeaksOnceInItsTurnAndNotBefore) {
  EXPECT_EQ(speak(0), 0U);
  EXPECT_EQ(ship_.sender(), nullptr) << "nobody to speak to";
  ASSERT_EQ(hear(1, uplink(1, false)), FrameVerdict::kAccepted);
  EXPECT_EQ(speak(1), 0U);
  ASSERT_EQ(hear(2, uplink(2, true)), FrameVerdict::kAccepted);
  const std::size_t size = speak(2);
  ASSERT_GT(size, 0U);
  DownlinkReceiver vehicle(kIdentity, std::nullopt, kStart_ns);
  const auto result = vehicle.accept(at(3), std::span(out_).first(size));
  ASSERT_TRUE(result.content.acknowledgement);
  EXPECT_EQ(result.content.acknowledgement->newest, 2);
  EXPECT_EQ(result.content.acknowledgement->heard(1), true);
  EXPECT_EQ(speak(2.1), 0U);
}

TEST_F(ShipLinkTest, AVehicleThatSpeaksAgainHasTakenTheTurnBack) {
  (void)hear(1, uplink(1, true));
  (void)hear(1.5, uplink(2, false));
  EXPECT_EQ(speak(1.5), 0U);
}

TEST_F(ShipLinkTest, ATurnThatWasNotUsedIsOver) {
  (void)hear(1, uplink(1, true));
  EXPECT_EQ(speak(5), 0U);
}

TEST_F(ShipLinkTest, AfterALongSilenceTheShipSpeaksUnaskedAndSeldom) {
  (void)hear(1, uplink(1, false));
  EXPECT_EQ(speak(60), 0U);
  EXPECT_GT(speak(61), 0U);
  EXPECT_EQ(speak(62), 0U);
  EXPECT_EQ(speak(120), 0U);
  EXPECT_GT(speak(121), 0U);
  (void)hear(130, uplink(2, false));
  EXPECT_EQ(speak(185), 0U);
}

TEST_F(ShipLinkTest, DamagedAndForeignFramesGiveNoTurn) {
  (void)hear(1, uplink(1, false));
  Bytes damaged = uplink(2, true);
  damaged[7] ^= 1;
  EXPECT_EQ(hear(2, damaged), FrameVerdict::kBadTag);
  EXPECT_EQ(speak(2), 0U);
}

TEST_F(ShipLinkTest, AShipThatKnowsItsVehicleMaySpeakBeforeItHears) {
  ShipLink ship(kIdentity, std::nullopt);
  ASSERT_NE(ship.sender(), nullptr);
  Request request;
  request.kind = Request::Kind::kSendStatus;
  ASSERT_TRUE(ship.sender()->request(request));
  EXPECT_EQ(ship.nextFrame(at(0), out_), 0U);
  EXPECT_GT(ship.nextFrame(at(60), out_), 0U);
}

}  // namespace
}  // namespace fathom::telemetry
