// A million frames that are forged, altered, replayed, old or out of order, up and down, between true ones:
// none is taken, and no true one waits for it.
#include <gtest/gtest.h>

#include <random>

#include "realtime/base/bytes/crc32.hpp"
#include "telemetry/downlink/downlink.hpp"
#include "telemetry/ship/link_receiver.hpp"
#include "tests/telemetry/sample_frames.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::int64_t kWeek_ns = 7 * 86'400 * kSecond_ns;
constexpr int kTrue = 2000, kFalseEach = 500;

Bytes noise(std::mt19937& random, std::size_t most) {
  Bytes bytes(1 + random() % most);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
  return bytes;
}

Bytes framed(Version version, std::span<const std::uint8_t> body, const FrameTag& tag,
             MessageType type = MessageType::kMapPacket) {
  return frameWith({kOurs, version, type}, body, tag);
}

Bytes altered(std::mt19937& random, const Bytes& frame) {
  Bytes changed = frame;
  for (std::size_t left = 1 + random() % 4; left > 0 || changed == frame; left -= left > 0 ? 1 : 0)
    changed[random() % changed.size()] ^= static_cast<std::uint8_t>(1 + random() % 255);
  return changed;
}

// A frame of the protocol before, which anybody can make.
Bytes endedWithCrc(Bytes frame) {
  frame[0] = static_cast<std::uint8_t>((frame[0] & 15U) | 3U << 4);
  const std::uint32_t crc = crc32(std::span(frame).first(frame.size() - 4));
  for (std::size_t i = 0; i < 4; ++i)
    frame[frame.size() - 4 + i] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
  return frame;
}

TEST(Attack, OfAMillionFalseFramesNoneIsShownAndNoTrueFrameWaits) {
  std::mt19937 random(1);
  const FrameTag tag(keyOf(1)), other(keyOf(2));
  std::vector<Bytes> bodies, frames, last_week;
  for (int k = 0; k < kTrue; ++k) {
    bodies.push_back(noise(random, 60));
    frames.push_back(framed(firstVersion(kStart_ns) + static_cast<Version>(k), bodies.back(), tag));
    last_week.push_back(
        framed(firstVersion(kStart_ns - kWeek_ns) + static_cast<Version>(k), noise(random, 60), tag));
  }
  LinkReceiver ship(kOurs, tag);
  std::vector<Bytes> shown;
  const auto deliver = [&](const LinkReceiver::Message& m) {
    shown.emplace_back(m.payload.begin(), m.payload.end());
    return true;
  };
  std::int64_t now_ns = kStart_ns + 3600 * kSecond_ns;
  const auto falseFrame = [&](int sent) {
    const Version next = firstVersion(kStart_ns) + static_cast<Version>(sent);
    const auto any = [&](const std::vector<Bytes>& of) { return of[random() % static_cast<unsigned>(sent)]; };
    switch (random() % (sent > 0 ? 9 : 6)) {
      case 0:
        return noise(random, kMaxFrameBytes);
      case 1:
        return altered(random, frames[static_cast<std::size_t>(sent)]);
      case 2:
        return framed(next + random() % 3, noise(random, 60), other);
      case 3:
        return framed(next, noise(random, 60), FrameTag());
      case 4:
        return endedWithCrc(framed(next, noise(random, 60), FrameTag()));
      case 5:
        return framed(next, noise(random, 60), other, MessageType::kRepair);
      case 6:
        return any(frames);
      case 7:
        return any(last_week);
      default:
        return altered(random, any(frames));
    }
  };
  for (int k = 0; k < kTrue; ++k) {
    for (int n = 0; n < kFalseEach; ++n, now_ns += kSecond_ns / 5000)
      ASSERT_NE(ship.accept(falseFrame(k), deliver, now_ns).verdict, FrameVerdict::kAccepted);
    ASSERT_EQ(ship.accept(frames[static_cast<std::size_t>(k)], deliver, now_ns).verdict,
              FrameVerdict::kAccepted);
  }
  EXPECT_EQ(shown, bodies);
  EXPECT_GT(ship.counters()[FrameVerdict::kBadTag], 100'000U);
  EXPECT_GT(ship.counters()[FrameVerdict::kDuplicate], 50'000U);
}

TEST(Attack, OfAMillionFalseFramesNoneIsObeyedAndNoTrueFrameWaits) {
  std::mt19937 random(2);
  DownlinkReceiver vehicle(kOurs, keyOf(1), kStart_ns);
  DownlinkSender ship(kOurs, keyOf(1)), forger(kOurs, keyOf(2)), keyless(kOurs, std::nullopt);
  std::vector<Bytes> said;
  std::int64_t now_ns = kStart_ns;
  const auto frameOf = [&](DownlinkSender& from, std::uint16_t newest) {
    from.acknowledge(Acknowledgement{.valid = true, .newest = newest, .before = {}});
    (void)from.request(Request{.kind = Request::Kind::kRate, .rate_bps = 100.0 + 10 * (newest % 50)});
    Bytes out(kMinFrameBytes);
    out.resize(from.nextFrame(now_ns, out));
    return out;
  };
  std::uint64_t obeyed = 0;
  const auto sent_lately = [](const Acknowledgement& a) { return std::optional<Version>(a.newest); };
  for (int k = 0; k < kTrue; ++k, now_ns += kSecond_ns) {
    const auto newest = static_cast<std::uint16_t>(k + 1);
    const Bytes next = frameOf(ship, newest);
    for (int n = 0; n < kFalseEach; ++n) {
      Bytes frame;
      switch (random() % (said.empty() ? 4 : 6)) {
        case 0:
          frame = noise(random, 64);
          break;
        case 1:
          frame = altered(random, next);
          break;
        case 2:
          frame = frameOf(forger, newest);
          break;
        case 3:
          frame = frameOf(keyless, newest);
          break;
        case 4:
          frame = said[random() % said.size()];
          break;
        default:
          frame = altered(random, said[random() % said.size()]);
      }
      ASSERT_NE(vehicle.accept(now_ns, frame, sent_lately).verdict, DownlinkVerdict::kAccepted);
    }
    const auto result = vehicle.accept(now_ns, next, sent_lately);
    ASSERT_EQ(result.verdict, DownlinkVerdict::kAccepted) << k;
    obeyed += result.content.request ? 1 : 0;
    said.push_back(next);
  }
  EXPECT_EQ(obeyed, vehicle.counters().requests);
  EXPECT_GT(obeyed, static_cast<std::uint64_t>(kTrue) / 2);
}

// A ship whose clock is far off, or that receives a recording of another year, follows after two frames.
TEST(Attack, AShipWhoseClockIsYearsOffFollowsTheVehicleAfterTwoFrames) {
  const FrameTag tag(keyOf(1));
  LinkReceiver ship(kOurs, tag);
  const Bytes body(20, 3);
  std::vector<Version> received;
  for (Version k = 0; k < 10; ++k)
    (void)ship.accept(
        framed(firstVersion(kStart_ns) + k, body, tag),
        [&](const LinkReceiver::Message& m) {
          received.push_back(m.version);
          return true;
        },
        kStart_ns - 100 * kWeek_ns + k * 5 * kSecond_ns);
  EXPECT_EQ(received.size(), 9U);
  EXPECT_EQ(received.front(), firstVersion(kStart_ns) + 1);
}

TEST(Attack, AnotherDiveOfTheSameNumbersTakesThePlaceOfTheOneBefore) {
  const FrameTag tag(keyOf(1));
  std::mt19937 random(4);
  LinkReceiver ship(kOurs, tag);
  const auto take = [&](std::int64_t start_ns, Version k) {
    return ship
        .accept(
            framed(firstVersion(start_ns) + k, noise(random, 40), tag), [](const auto&) { return true; },
            start_ns + 100 * kSecond_ns)
        .verdict;
  };
  for (Version k = 0; k < 1000; ++k) ASSERT_EQ(take(kStart_ns, k), FrameVerdict::kAccepted);
  const Version before = ship.began();
  ASSERT_EQ(take(kStart_ns + kWeek_ns, 0), FrameVerdict::kAccepted);
  EXPECT_GT(ship.began(), before);
  EXPECT_EQ(ship.counters().lost, 0U);
  EXPECT_EQ(take(kStart_ns, 2000), FrameVerdict::kOld);
}

}  // namespace
}  // namespace fathom::telemetry
