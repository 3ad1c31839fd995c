#include "telemetry/web/access.hpp"

#include <sys/random.h>

#include <array>
#include <cstdint>
#include <stdexcept>

namespace fathom::web {
namespace {

constexpr std::string_view kCookieName = "fathom_token";

std::string_view cookieToken(std::string_view cookies) {
  while (!cookies.empty()) {
    const std::size_t end = cookies.find(';');
    std::string_view one = cookies.substr(0, end);
    while (!one.empty() && one.front() == ' ') one.remove_prefix(1);
    if (one.size() > kCookieName.size() && one.starts_with(kCookieName) && one[kCookieName.size()] == '=')
      return one.substr(kCookieName.size() + 1);
    if (end == std::string_view::npos) break;
    cookies.remove_prefix(end + 1);
  }
  return {};
}

std::string_view withoutPort(std::string_view host) {
  if (host.starts_with('['))
    return host.substr(1, host.find(']') == std::string_view::npos ? 0 : host.find(']') - 1);
  return host.substr(0, host.find(':'));
}

}  // namespace

// In constant time: how long it takes tells nothing about how much of the token was right.
bool Access::matches(std::string_view given) const {
  unsigned difference = given.size() == token_.size() ? 0 : 1;
  for (std::size_t i = 0; i < token_.size(); ++i) {
    const char c = given.empty() ? '\0' : given[i % given.size()];
    difference |=
        static_cast<unsigned>(static_cast<unsigned char>(c) ^ static_cast<unsigned char>(token_[i]));
  }
  return difference == 0;
}

AccessVerdict Access::judge(const AccessRequest& request) const {
  AccessVerdict verdict = AccessVerdict::kEnter;
  if (token_.empty()) {
    if (!isLoopback(withoutPort(request.host))) return AccessVerdict::kForbidden;
  } else if (!matches(request.token_header) && !matches(cookieToken(request.cookie))) {
    if (!matches(request.token_query)) return AccessVerdict::kUnauthorised;
    verdict = AccessVerdict::kEnterAndSetCookie;
  }
  const bool own =
      request.fetch_site.empty() || request.fetch_site == "same-origin" || request.fetch_site == "none";
  if (request.method != "GET" && request.method != "HEAD" && !(request.has_page_header && own))
    return AccessVerdict::kForbidden;
  return verdict;
}

std::string Access::setCookie() const {
  return std::string(kCookieName) + '=' + token_ + "; Path=/; HttpOnly; SameSite=Strict";
}

bool isLoopback(std::string_view address) {
  return address == "localhost" || address == "::1" ||
         (address.starts_with("127.") && address.find_first_not_of("0123456789.") == std::string_view::npos);
}

std::string makeToken() {
  std::array<std::uint8_t, 16> bytes{};
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
    throw std::runtime_error("the system gives no random numbers for a token");
  std::string token;
  for (const std::uint8_t byte : bytes) {
    token += "0123456789abcdef"[byte >> 4];
    token += "0123456789abcdef"[byte & 15];
  }
  return token;
}

}  // namespace fathom::web
