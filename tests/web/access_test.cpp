#include "telemetry/web/access.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "realtime/base/input_error.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::web {
namespace {

constexpr const char* kToken = "0123456789abcdef";

TEST(Access, WithATokenNothingEntersWithoutIt) {
  const Access access(kToken);
  const auto judge = [&](std::string_view cookie, std::string_view header, std::string_view query) {
    return access.judge({"GET", "ship.example:8080", cookie, header, query, "", false});
  };
  EXPECT_EQ(judge("", "", ""), AccessVerdict::kUnauthorised);
  EXPECT_EQ(judge("", "", "0123456789abcdeF"), AccessVerdict::kUnauthorised);
  EXPECT_EQ(judge("", "", "0123456789abcdef0123456789abcdef"), AccessVerdict::kUnauthorised);
  EXPECT_EQ(judge("fathom_token=0123456789abcde; other=1", "", ""), AccessVerdict::kUnauthorised);
  EXPECT_EQ(judge("not_fathom_token=0123456789abcdef", "", ""), AccessVerdict::kUnauthorised);
  EXPECT_EQ(judge("a=b; fathom_token=0123456789abcdef", "", ""), AccessVerdict::kEnter);
  EXPECT_EQ(judge("", kToken, ""), AccessVerdict::kEnter);
  EXPECT_EQ(judge("", "", kToken), AccessVerdict::kEnterAndSetCookie);
}

TEST(Access, WhatChangesSomethingNeedsThePagesOwnHeader) {
  const Access with(kToken), without("");
  EXPECT_EQ(with.judge({"POST", "h", "fathom_token=0123456789abcdef", "", "", "", false}),
            AccessVerdict::kForbidden);
  EXPECT_EQ(with.judge({"POST", "h", "fathom_token=0123456789abcdef", "", "", "", true}),
            AccessVerdict::kEnter);
  EXPECT_EQ(without.judge({"POST", "127.0.0.1:80", "", "", "", "", false}), AccessVerdict::kForbidden);
  EXPECT_EQ(without.judge({"DELETE", "127.0.0.1:80", "", "", "", "", false}), AccessVerdict::kForbidden);
  EXPECT_EQ(without.judge({"POST", "127.0.0.1:80", "", "", "", "", true}), AccessVerdict::kEnter);
  EXPECT_EQ(without.judge({"POST", "127.0.0.1:80", "", "", "", "same-origin", true}), AccessVerdict::kEnter);
  for (const char* site : {"cross-site", "same-site"})
    EXPECT_EQ(without.judge({"POST", "127.0.0.1:80", "", "", "", site, true}), AccessVerdict::kForbidden);
}

TEST(Access, WithoutATokenOnlyThisMachinesNamesEnter) {
  const Access access("");
  const auto judge = [&](std::string_view host) {
    return access.judge({"GET", host, "", "", "", "", false});
  };
  for (const char* host : {"127.0.0.1:8080", "localhost", "[::1]:8080", "127.9.9.9"})
    EXPECT_EQ(judge(host), AccessVerdict::kEnter) << host;
  for (const char* host : {"", "evil.example", "127.0.0.1.evil.example", "[::1", "[", "localhost.evil:80"})
    EXPECT_EQ(judge(host), AccessVerdict::kForbidden) << host;
  EXPECT_NE(makeToken(), makeToken());
  EXPECT_EQ(makeToken().size(), 32U);
}

TEST(Access, ATokenComesFromAFileOfOneLine) {
  const test::TemporaryFolder folder;
  const auto file = folder.path() / "token";
  const auto read = [&](const std::string& text, std::string& warning) {
    std::ofstream(file, std::ios::binary) << text;
    return readToken(file, warning);
  };
  std::string warning;
  EXPECT_EQ(read("0123456789abcdef\n", warning), kToken);
  EXPECT_NE(warning, "") << "others may read it";
  std::filesystem::permissions(file, std::filesystem::perms::owner_all);
  warning.clear();
  EXPECT_EQ(read(kToken, warning), kToken);
  EXPECT_EQ(warning, "");
  for (const std::string& bad : {std::string(), std::string("short"), std::string("two lines\nand more"),
                                 std::string("0123456789abcdef\n\n"), std::string(129, 'x'),
                                 std::string(10'000, 'x'), std::string("header\r\nX: 1")})
    EXPECT_THROW((void)read(bad, warning), InputError) << bad;
  EXPECT_THROW((void)readToken(folder.path() / "absent", warning), InputError);
  EXPECT_THROW((void)readToken(folder.path(), warning), InputError);
}

}  // namespace
}  // namespace fathom::web
