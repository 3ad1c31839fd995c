#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <random>
#include <set>

#include "telemetry/ship/ship_link.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/link_key.hpp"
#include "tests/support/test_data.hpp"
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
  ASSERT_TRUE(ship.sender()->request(Request{.kind = Request::Kind::kSendStatus}));
  EXPECT_EQ(ship.nextFrame(at(0), out_), 0U);
  EXPECT_GT(ship.nextFrame(at(60), out_), 0U);
}

constexpr LinkIdentity kIdentity{3, 17};

class LinkKeyFile : public ::testing::Test {
 protected:
  void write(const std::string& text) const {
    test::writeText(file_, text);
    ::chmod(file_.c_str(), S_IRUSR | S_IWUSR);
  }
  [[nodiscard]] std::string refusal() const {
    std::string warning;
    return test::refusal([&] { (void)readLinkKey(file_, warning); });
  }
  const test::TemporaryFolder temporary_;
  const std::filesystem::path folder_ = temporary_.path(), file_ = folder_ / "ship.key";
};

TEST_F(LinkKeyFile, ANewKeyIsReadBackAndIsForItsOwnerAlone) {
  makeLinkKey(file_);
  struct stat about {};
  ASSERT_EQ(::stat(file_.c_str(), &about), 0);
  EXPECT_EQ(about.st_mode & 0777U, 0600U);
  std::string warning = "left over";
  const LinkKey key = readLinkKey(file_, warning);
  EXPECT_EQ(warning, "");
  const std::array<std::uint8_t, 3> message = {1, 2, 3};
  EXPECT_TRUE(key.verify(kIdentity, message, readLinkKey(file_, warning).sign(kIdentity, message)));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_), {}), 1) << "no temporary file stays";
}

TEST_F(LinkKeyFile, EveryNewKeyIsAnother) {
  std::set<std::string> keys;
  for (int i = 0; i < 5; ++i) {
    const std::filesystem::path file = folder_ / std::to_string(i);
    makeLinkKey(file);
    keys.insert(test::readText(file));
  }
  EXPECT_EQ(keys.size(), 5U);
}

TEST_F(LinkKeyFile, AKeyIsNeverOverwritten) {
  write("precious");
  EXPECT_THROW(makeLinkKey(file_), InputError);
  EXPECT_EQ(test::readText(file_), "precious");
  EXPECT_THROW(makeLinkKey(folder_ / "nowhere" / "ship.key"), InputError);
}

TEST_F(LinkKeyFile, AFileThatOthersMayReadIsWarnedOf) {
  makeLinkKey(file_);
  ::chmod(file_.c_str(), 0640);
  std::string warning;
  (void)readLinkKey(file_, warning);
  EXPECT_NE(warning.find("chmod 600"), std::string::npos) << warning;
}

TEST_F(LinkKeyFile, LineEndsOfEitherKindAndNoneAreRead) {
  const std::string digits(64, 'a');
  for (const char* end : {"", "\n", "\r\n"}) {
    write(digits + end);
    EXPECT_EQ(refusal(), "");
  }
}

TEST_F(LinkKeyFile, AnythingButSixtyFourHexadecimalDigitsIsRefused) {
  const std::string digits(64, 'a');
  EXPECT_NE(refusal().find("cannot be read"), std::string::npos);
  for (const std::string& text :
       {std::string(), std::string("\n"), digits.substr(1), digits + "a", "g" + digits.substr(1),
        " " + digits.substr(1), digits + "\n\n", std::string(100000, 'b')}) {
    write(text);
    EXPECT_NE(refusal().find("64 hexadecimal digits"), std::string::npos) << text.substr(0, 70);
    EXPECT_EQ(refusal().find("aaaa"), std::string::npos) << "a key is not shown to anybody";
  }
  std::filesystem::remove(file_);
  ASSERT_EQ(::mkfifo(file_.c_str(), 0600), 0);
  EXPECT_NE(refusal().find("is no file"), std::string::npos);
}

TEST(LinkKey, ASignatureHoldsForOneMessageVehicleDiveAndKey) {
  std::mt19937 random(4);
  std::array<std::uint8_t, LinkKey::kBytes> secret{};
  for (std::uint8_t& b : secret) b = static_cast<std::uint8_t>(random());
  const LinkKey key(secret);
  secret[31] ^= 1;
  const LinkKey other(secret);
  const std::array<std::uint8_t, 4> message = {9, 8, 7, 6};
  const LinkKey::Signature good = key.sign(kIdentity, message);
  EXPECT_TRUE(key.verify(kIdentity, message, good));
  EXPECT_FALSE(other.verify(kIdentity, message, good));
  EXPECT_FALSE(key.verify({4, 17}, message, good));
  EXPECT_FALSE(key.verify({3, 18}, message, good));
  EXPECT_FALSE(key.verify(kIdentity, std::span(message).first(3), good));
  EXPECT_FALSE(key.verify(kIdentity, message, std::span(good).first(4)));
  EXPECT_FALSE(key.verify(kIdentity, message, {}));
  for (std::size_t bit = 0; bit < 8 * good.size(); ++bit) {
    LinkKey::Signature bad = good;
    bad[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    EXPECT_FALSE(key.verify(kIdentity, message, bad)) << bit;
  }
}

TEST(LinkKey, TheSignatureIsTheStartOfKeyedBlake2b) {
  // Computed apart: hashlib.blake2b(b"Fathom downlink 3" + bytes([3, 0, 17]) + b"abc", digest_size=16,
  // key=bytes(range(32))).
  std::array<std::uint8_t, LinkKey::kBytes> secret{};
  for (std::size_t i = 0; i < secret.size(); ++i) secret[i] = static_cast<std::uint8_t>(i);
  const std::array<std::uint8_t, 3> message = {'a', 'b', 'c'};
  const LinkKey::Signature expected = {0x16, 0xbd, 0x34, 0xd1, 0x9e};
  EXPECT_EQ(LinkKey(secret).sign(kIdentity, message), expected);
}

}  // namespace
}  // namespace fathom::telemetry
