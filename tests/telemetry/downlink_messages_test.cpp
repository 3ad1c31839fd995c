#include "telemetry/wire/downlink_messages.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <array>

namespace fathom::telemetry {
namespace {

constexpr std::int64_t kNow_ns = 1'790'000'000 * kSecond_ns + 123'000'000;
// What a frame of 32 B has left when its header, CRC and signature of 5 B are in.
constexpr std::size_t kSmallest = 17;

UsblFixMessage someFix() {
  return {kNow_ns - 2'340'000'000, -33.1234567, 151.7654321, 42.5, 1.3};
}

Request someDetail() {
  return Request{.kind = Request::Kind::kDetail,
                 .id = 11,
                 .north_min = -120.4,
                 .north_max = -100.2,
                 .east_min = 33.3,
                 .east_max = 63.0,
                 .spacing = 1.0 / 16,
                 .max_error = 0.02};
}

DecodedDownlink roundTrip(const DownlinkContent& content, std::size_t room = kSmallest) {
  std::array<std::uint8_t, 64> buffer{};
  const std::size_t size =
      encodeDownlink(content, downlinkCounterAt(kNow_ns), false, std::span(buffer).first(room));
  EXPECT_GT(size, 0U);
  DecodedDownlink decoded;
  EXPECT_TRUE(decodeDownlink(std::span(buffer).first(size), decoded));
  return decoded;
}

TEST(DownlinkMessages, AFixFitsTheSmallestFrameAndKeepsItsResolution) {
  const auto fix = roundTrip({someFix(), {}, {}}).content.fix;
  ASSERT_TRUE(fix);
  EXPECT_NEAR(static_cast<double>(fix->utc_ns - someFix().utc_ns), 0, 5e6);
  EXPECT_NEAR(fix->latitude, someFix().latitude, 0.5001e-7);
  EXPECT_NEAR(fix->longitude, someFix().longitude, 0.5001e-7);
  EXPECT_NEAR(fix->depth, 42.5, 0.251);
  EXPECT_NEAR(fix->sigma, 1.3, 0.051);
}

TEST(DownlinkMessages, AFixMayLackDepthAndSigma) {
  UsblFixMessage bare = someFix();
  bare.depth = bare.sigma = std::nan("");
  const auto fix = roundTrip({bare, {}, {}}).content.fix;
  ASSERT_TRUE(fix);
  EXPECT_TRUE(std::isnan(fix->depth));
  EXPECT_TRUE(std::isnan(fix->sigma));
}

TEST(DownlinkMessages, AFixTooOldOrFromTheFutureIsNotSent) {
  std::array<std::uint8_t, 64> buffer{};
  UsblFixMessage fix = someFix();
  fix.utc_ns = kNow_ns - 200 * kSecond_ns;
  EXPECT_EQ(encodeDownlink({fix, {}, {}}, downlinkCounterAt(kNow_ns), false, buffer), 0U);
  fix.utc_ns = kNow_ns + kSecond_ns;
  EXPECT_EQ(encodeDownlink({fix, {}, {}}, downlinkCounterAt(kNow_ns), false, buffer), 0U);
}

TEST(DownlinkMessages, EveryRequestFitsTheSmallestFrameAndComesBack) {
  const auto detail = roundTrip({{}, someDetail(), {}}).content.request;
  ASSERT_TRUE(detail);
  EXPECT_EQ(detail->kind, Request::Kind::kDetail);
  EXPECT_EQ(detail->id, 11);
  EXPECT_NEAR(detail->north_min, -120.4, 0.0501);
  EXPECT_NEAR(detail->north_max, -100.2, 0.1001);
  EXPECT_NEAR(detail->east_min, 33.3, 0.0501);
  EXPECT_NEAR(detail->east_max, 63.0, 0.1001);
  EXPECT_EQ(detail->spacing, 1.0 / 16);
  EXPECT_NEAR(detail->max_error, 0.02, 1e-9);
  for (std::size_t kind = 1; kind < kRequestKinds; ++kind) {
    Request request{.kind = static_cast<Request::Kind>(kind), .rate_bps = 300};
    const auto back = roundTrip({{}, request, {}}).content.request;
    ASSERT_TRUE(back) << kind;
    EXPECT_EQ(back->kind, request.kind);
    if (request.kind == Request::Kind::kRate) {
      EXPECT_EQ(back->rate_bps, 300);
    }
  }
}

TEST(DownlinkMessages, RequestsOutOfBoundsAreRefused) {
  Request request = someDetail();
  EXPECT_TRUE(validate(request));
  request.north_max = request.north_min;
  EXPECT_FALSE(validate(request));
  request = someDetail();
  request.east_max = request.east_min + 900;
  EXPECT_FALSE(validate(request));
  request = someDetail();
  request.spacing = 0.3;
  EXPECT_FALSE(validate(request));
  request = someDetail();
  request.max_error = std::nan("");
  EXPECT_FALSE(validate(request));
  request.kind = Request::Kind::kRate;
  request.rate_bps = 10;
  EXPECT_FALSE(validate(request));
}

TEST(DownlinkMessages, TheLargestRequestSurvivesItsOwnRounding) {
  Request request = someDetail();
  request.north_min = -52428.7;
  request.north_max = request.north_min + 819.2;
  request.east_min = 52428.7;
  request.east_max = request.east_min + 819.2;
  request.max_error = 0.32;
  ASSERT_TRUE(validate(request));
  EXPECT_TRUE(roundTrip({{}, request, {}}).content.request);
}

TEST(DownlinkMessages, AnAcknowledgementSpeaksOfAsManyFramesAsItsFrameHoldsAndOfNoOthers) {
  Acknowledgement sent{.valid = true, .before = {}};
  sent.newest = 5;  // the frames before it are beyond the wrap
  sent.reach = Acknowledgement::kMaxReach;
  for (std::size_t i = 0; i < sent.reach; i += 3) sent.before.set(i);
  const auto small = roundTrip({{}, {}, sent}).content.acknowledgement;
  ASSERT_TRUE(small);
  EXPECT_EQ(small->reach, 83U);
  EXPECT_EQ(small->received(5), true);
  EXPECT_EQ(small->received(4), true);
  EXPECT_EQ(small->received(3), false);
  EXPECT_EQ(small->received(65536 - 78), false);  // bit 82
  EXPECT_EQ(small->received(65536 - 79), std::nullopt);
  EXPECT_EQ(small->received(6), std::nullopt);
  const auto whole = roundTrip({{}, {}, sent}, 40).content.acknowledgement;
  ASSERT_TRUE(whole);
  EXPECT_EQ(*whole, sent);
}

TEST(DownlinkMessages, AnAcknowledgementSaysHowManyFramesLackBeforeThoseItLists) {
  for (const std::uint16_t lacking :
       {std::uint16_t{8}, std::uint16_t{200}, std::uint16_t{0xFFFE}, Acknowledgement::kAll})
    for (std::size_t reach = 0; reach < 40; ++reach) {
      Acknowledgement sent{.valid = true, .newest = 1000, .reach = reach, .before = {}};
      for (std::size_t i = 0; i < reach; i += 3) sent.before.set(i);
      sent.lacking = lacking;
      const auto got = roundTrip({{}, {}, sent}).content.acknowledgement;
      ASSERT_TRUE(got);
      for (std::uint32_t back = 0; back < 70000; back += back < 300 ? 1 : 1001)
        ASSERT_EQ(got->receivedBack(back), sent.receivedBack(back)) << lacking << ' ' << reach << ' ' << back;
    }
}

TEST(DownlinkMessages, OneFrameMayCarryAllThree) {
  Acknowledgement sent{.valid = true, .newest = 700, .before = {}};
  const DecodedDownlink decoded = roundTrip({someFix(), someDetail(), sent}, 54);
  EXPECT_TRUE(decoded.content.fix);
  EXPECT_TRUE(decoded.content.request);
  ASSERT_TRUE(decoded.content.acknowledgement);
  EXPECT_EQ(decoded.content.acknowledgement->newest, 700);
}

TEST(DownlinkMessages, AnAcknowledgementWithoutRoomIsLeftOutOfAFrameWithSomethingElse) {
  Acknowledgement sent{.valid = true, .before = {}};
  const DecodedDownlink decoded = roundTrip({someFix(), {}, sent});
  EXPECT_TRUE(decoded.content.fix);
  EXPECT_FALSE(decoded.content.acknowledgement);
}

TEST(DownlinkMessages, TheCounterIsTheTimeInTenthsOfSecondsRoundedUp) {
  EXPECT_EQ(downlinkTime(downlinkCounterAt(1'735'689'600 * kSecond_ns)), 1'735'689'600 * kSecond_ns);
  EXPECT_EQ(downlinkCounterAt(1'735'689'600 * kSecond_ns + 1), 1U);
  EXPECT_EQ(downlinkCounterAt(0), 0U);
  EXPECT_GE(downlinkTime(downlinkCounterAt(kNow_ns)), kNow_ns);
}

TEST(DownlinkMessages, EveryTruncationAndEmptyContentIsRefused) {
  std::array<std::uint8_t, 64> buffer{};
  EXPECT_EQ(encodeDownlink({}, 1, false, buffer), 0U);
  const std::size_t size =
      encodeDownlink({someFix(), someDetail(), {}}, downlinkCounterAt(kNow_ns), true, buffer);
  ASSERT_GT(size, 0U);
  DecodedDownlink decoded;
  for (std::size_t n = 0; n < size; ++n)
    EXPECT_FALSE(decodeDownlink(std::span(buffer).first(n), decoded)) << n;
  EXPECT_TRUE(decodeDownlink(std::span(buffer).first(size), decoded));
  EXPECT_TRUE(decoded.is_signed);
}

}  // namespace
}  // namespace fathom::telemetry
