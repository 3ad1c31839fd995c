#include "telemetry/ship/ship_link.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <vector>

#include "telemetry/wire/bundle.hpp"
#include "tests/telemetry/sample_frames.hpp"

namespace fathom::telemetry {
namespace {

Bytes uplink(std::uint16_t sequence, bool turn) {
  return frameWith({kOurs, sequence, MessageType::kTrack, turn}, Bytes{1, 2, 3, 4});
}

class ShipLinkTest : public ::testing::Test {
 protected:
  FrameVerdict receive(double seconds, const Bytes& frame) {
    return ship_.accept(at(seconds), frame, [](const auto&) { return true; }).verdict;
  }
  std::size_t speak(double seconds) { return ship_.nextFrame(at(seconds), out_); }
  static std::int64_t at(double seconds) { return kStart_ns + static_cast<std::int64_t>(seconds * 1e9); }

  ShipLink ship_{std::nullopt, std::nullopt};
  // As a modem frame.
  bool receiveModem(double seconds, std::span<const std::uint8_t> modem_frame) {
    return ship_.receive(modem_frame, [&](std::span<const std::uint8_t> frame) {
      return receive(seconds, {frame.begin(), frame.end()}) == FrameVerdict::kAccepted;
    });
  }

  std::array<std::uint8_t, kMaxModemBytes> out_{};
};

Bytes bundle(std::initializer_list<Bytes> frames, std::size_t modem_bytes, bool padded) {
  Bytes out(modem_bytes);
  ModemFrameWriter writer(out, padded);
  for (const Bytes& frame : frames) {
    std::copy(frame.begin(), frame.end(), writer.room().begin());
    writer.add(frame.size());
  }
  out.resize(writer.finish());
  return out;
}

TEST_F(ShipLinkTest, TheShipSpeaksOnceInItsTurnAndNotBefore) {
  EXPECT_EQ(speak(0), 0U);
  EXPECT_EQ(ship_.sender(), nullptr) << "nobody to speak to";
  ASSERT_EQ(receive(1, uplink(1, false)), FrameVerdict::kAccepted);
  EXPECT_EQ(speak(1), 0U);
  ASSERT_EQ(receive(2, uplink(2, true)), FrameVerdict::kAccepted);
  const std::size_t size = speak(2);
  ASSERT_GT(size, 0U);
  DownlinkReceiver vehicle(kOurs, std::nullopt, kStart_ns);
  const auto result = vehicle.accept(at(3), std::span(out_).first(size));
  ASSERT_TRUE(result.content.acknowledgement);
  EXPECT_EQ(result.content.acknowledgement->newest, 2);
  EXPECT_EQ(result.content.acknowledgement->received(1), true);
  EXPECT_EQ(speak(2.1), 0U);
}

TEST_F(ShipLinkTest, AVehicleThatSpeaksAgainHasTakenTheTurnBack) {
  (void)receive(1, uplink(1, true));
  (void)receive(1.5, uplink(2, false));
  EXPECT_EQ(speak(1.5), 0U);
}

TEST_F(ShipLinkTest, ATurnThatWasNotUsedIsOver) {
  (void)receive(1, uplink(1, true));
  EXPECT_EQ(speak(5), 0U);
}

TEST_F(ShipLinkTest, AfterALongSilenceTheShipSpeaksUnaskedAndSeldom) {
  (void)receive(1, uplink(1, false));
  EXPECT_EQ(speak(60), 0U);
  EXPECT_GT(speak(61), 0U);
  EXPECT_EQ(speak(62), 0U);
  EXPECT_EQ(speak(120), 0U);
  EXPECT_GT(speak(121), 0U);
  (void)receive(130, uplink(2, false));
  EXPECT_EQ(speak(185), 0U);
}

TEST_F(ShipLinkTest, DamagedAndForeignFramesGiveNoTurn) {
  (void)receive(1, uplink(1, false));
  Bytes damaged = uplink(2, true);
  damaged[7] ^= 1;
  EXPECT_EQ(receive(2, damaged), FrameVerdict::kBadTag);
  EXPECT_EQ(speak(2), 0U);
}

TEST_F(ShipLinkTest, ReceivesEveryLinkFrameOfABundleAndAnswersTheLast) {
  EXPECT_TRUE(receiveModem(1, bundle({uplink(1, false), uplink(2, false), uplink(3, true)}, 100, false)));
  EXPECT_EQ(ship_.receiver().counters()[FrameVerdict::kAccepted], 3U);
  const std::size_t size = speak(1);
  ASSERT_GT(size, 0U);
  EXPECT_LE(size, kMinFrameBytes) << "as it is: the vehicle's modem takes frames of any size";
  EXPECT_NE(out_[0], kBundleMark);
}

TEST_F(ShipLinkTest, PadsItsAnswerAsTheVehicleDoes) {
  ASSERT_TRUE(receiveModem(1, bundle({uplink(1, true)}, 128, true)));
  std::size_t size = speak(1);
  ASSERT_EQ(size, 128U);
  EXPECT_EQ(paddedBytes(std::span(out_).first(size)), 128U);
  LinkFrames frames(std::span<const std::uint8_t>(out_).first(size));
  DownlinkReceiver vehicle(kOurs, std::nullopt, kStart_ns);
  const auto frame = frames.next();
  ASSERT_TRUE(frame);
  EXPECT_TRUE(vehicle.accept(at(2), *frame).content.acknowledgement);
  EXPECT_FALSE(frames.next());
  // Full to the last byte: 1 + 7 x (1 + 14) and 1 + 21.
  const Bytes last = frameWith({kOurs, 9, MessageType::kTrack, true}, Bytes(22 - 1 - kFrameOverhead));
  const Bytes exact = bundle({uplink(2, false), uplink(3, false), uplink(4, false), uplink(5, false),
                              uplink(6, false), uplink(7, false), uplink(8, false), last},
                             128, true);
  ASSERT_EQ(paddedBytes(exact), 0U);
  ASSERT_TRUE(receiveModem(3, exact));
  EXPECT_EQ(speak(3), 128U);
  ASSERT_TRUE(receiveModem(5, uplink(10, true)));
  size = speak(5);
  EXPECT_TRUE(size > 0 && size <= kMinFrameBytes) << "another modem";
}

TEST_F(ShipLinkTest, ABundleWithoutAnAcceptedFrameChangesNothing) {
  ASSERT_TRUE(receiveModem(1, uplink(1, true)));
  Bytes damaged = uplink(2, true);
  damaged[7] ^= 1;
  EXPECT_FALSE(receiveModem(1.1, bundle({damaged}, 500, true)));
  EXPECT_FALSE(receiveModem(1.1, Bytes(300, 0)));
  EXPECT_FALSE(receiveModem(1.1, Bytes{kBundleMark, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(ship_.receiver().counters().frames, 4U) << "what holds no link frame is counted too";
  EXPECT_LE(speak(1.2), kMinFrameBytes);
}

TEST_F(ShipLinkTest, AShipThatKnowsItsVehicleMaySpeakBeforeItReceives) {
  ShipLink ship(kOurs, std::nullopt);
  ASSERT_NE(ship.sender(), nullptr);
  Request request;
  request.kind = Request::Kind::kSendStatus;
  ASSERT_TRUE(ship.sender()->request(request));
  EXPECT_EQ(ship.nextFrame(at(0), out_), 0U);
  EXPECT_GT(ship.nextFrame(at(60), out_), 0U);
}

}  // namespace
}  // namespace fathom::telemetry
