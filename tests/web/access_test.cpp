#include "telemetry/web/access.hpp"

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace fathom::web
