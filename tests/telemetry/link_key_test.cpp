#include "telemetry/wire/link_key.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <iterator>
#include <random>
#include <set>

#include "realtime/base/input_error.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::telemetry {
namespace {

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
