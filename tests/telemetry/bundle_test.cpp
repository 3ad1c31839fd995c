#include "telemetry/wire/bundle.hpp"

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "tests/telemetry/sample_frames.hpp"

namespace fathom::telemetry {
namespace {

Bytes linkFrame(std::uint16_t sequence, std::size_t payload_bytes) {
  const Bytes payload(payload_bytes, static_cast<std::uint8_t>(sequence));
  return frameWith({{3, 17}, sequence, MessageType::kTrack}, payload);
}

std::vector<Bytes> split(std::span<const std::uint8_t> modem_frame) {
  std::vector<Bytes> all;
  LinkFrames frames(modem_frame);
  while (const auto frame = frames.next()) all.emplace_back(frame->begin(), frame->end());
  return all;
}

// As many of the frames as there is room for, in a modem frame of `modem_bytes` at most.
Bytes joined(const std::vector<Bytes>& frames, std::size_t modem_bytes, bool padded) {
  Bytes out(modem_bytes, 0xAA);
  ModemFrameWriter writer(out, padded);
  for (const Bytes& frame : frames) {
    const auto room = writer.room();
    if (room.size() < frame.size()) break;
    std::copy(frame.begin(), frame.end(), room.begin());
    writer.add(frame.size());
  }
  out.resize(writer.finish());
  return out;
}

TEST(Bundle, OneLinkFrameGoesAsItIs) {
  const Bytes frame = linkFrame(1, 22);
  EXPECT_EQ(joined({frame}, 64, false), frame);
  EXPECT_EQ(split(frame), std::vector<Bytes>{frame});
  EXPECT_EQ(paddedBytes(frame), 0U);
}

TEST(Bundle, GivesBackTheLinkFramesThatWerePutIntoIt) {
  const std::vector<Bytes> frames = {linkFrame(1, 0), linkFrame(2, 22), linkFrame(3, 246), linkFrame(4, 5)};
  for (const bool padded : {false, true}) {
    const Bytes bundle = joined(frames, 600, padded);
    EXPECT_EQ(bundle.size(), padded ? 600U : 1U + (1 + 10) + (1 + 32) + (1 + 256) + (1 + 15));
    EXPECT_EQ(bundle[0], kBundleMark);
    EXPECT_EQ(split(bundle), frames);
    EXPECT_EQ(paddedBytes(bundle), padded ? 600U : 0U);
  }
}

TEST(Bundle, OnePaddedLinkFrameIsABundleToo) {
  const Bytes frame = linkFrame(1, 22);
  const Bytes bundle = joined({frame}, 64, true);
  EXPECT_EQ(bundle.size(), 64U);
  EXPECT_EQ(split(bundle), std::vector<Bytes>{frame});
  EXPECT_EQ(paddedBytes(bundle), 64U);
}

TEST(Bundle, HoldsNoMoreThanTheModemTakes) {
  const std::vector<Bytes> frames(10, linkFrame(1, 22));
  for (std::size_t modem_bytes = 64; modem_bytes < 340; ++modem_bytes)
    for (const bool padded : {false, true}) {
      const Bytes bundle = joined(frames, modem_bytes, padded);
      EXPECT_LE(bundle.size(), modem_bytes);
      EXPECT_EQ(split(bundle).size(), std::min<std::size_t>(10, (modem_bytes - 1) / 33)) << modem_bytes;
    }
}

TEST(Bundle, SaysBeforehandHowLongItWillBe) {
  Bytes out(300);
  ModemFrameWriter writer(out, false);
  for (const std::size_t payload : {5U, 22U, 100U}) {
    const Bytes frame = linkFrame(1, payload);
    const std::size_t predicted = writer.bytesWith(frame.size());
    std::copy(frame.begin(), frame.end(), writer.room().begin());
    writer.add(frame.size());
    EXPECT_EQ(writer.finish(), predicted);
  }
}

TEST(Bundle, CutShortItGivesTheLinkFramesThatAreWhole) {
  const std::vector<Bytes> frames = {linkFrame(1, 22), linkFrame(2, 22), linkFrame(3, 22)};
  const Bytes bundle = joined(frames, 200, false);
  for (std::size_t size = 0; size < bundle.size(); ++size) {
    // A heap block of exactly this size: the sanitizer sees a byte too many.
    const Bytes cut(bundle.begin(), bundle.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_EQ(split(cut).size(), size == 0 ? 0 : (size - 1) / 33) << size;
  }
}

TEST(Bundle, OfAnyBytesGivesPiecesInsideThem) {
  std::mt19937 random(7);
  for (int run = 0; run < 20000; ++run) {
    Bytes noise(random() % 300);
    for (std::uint8_t& byte : noise) byte = static_cast<std::uint8_t>(random() % 40);
    if (!noise.empty()) noise[0] = kBundleMark;
    std::size_t sum = 0;
    LinkFrames frames(noise);
    while (const auto frame = frames.next()) {
      ASSERT_GE(frame->data(), noise.data());
      ASSERT_LE(frame->data() + frame->size(), noise.data() + noise.size());
      ASSERT_LE(frame->size(), kMaxFrameBytes);
      sum += frame->size() + 1;
    }
    EXPECT_LE(sum + 1, std::max<std::size_t>(noise.size(), 1));
    (void)paddedBytes(noise);
  }
}

}  // namespace
}  // namespace fathom::telemetry
