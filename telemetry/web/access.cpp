#include "telemetry/web/access.hpp"

#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <fstream>
#include <stdexcept>

#include "realtime/base/input_error.hpp"

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

// Compares in constant time: the time shows nothing of how much of the token matched.
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

std::string readToken(const std::filesystem::path& file, std::string& warning) {
  constexpr std::size_t kLeastToken = 8, kMostToken = 128;
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) throw InputError(file.string(), "", "is no file");
  std::string token(kMostToken + 2, '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(token.data(), static_cast<std::streamsize>(token.size()));
  token.resize(static_cast<std::size_t>(in.gcount()));
  if (token.ends_with('\n')) token.pop_back();
  const auto plain = [](unsigned char c) { return std::isalnum(c) != 0 || c == '-' || c == '_'; };
  if (token.size() < kLeastToken || token.size() > kMostToken ||
      !std::all_of(token.begin(), token.end(), plain))
    throw InputError(file.string(), "", "must hold one line of 8 to 128 letters, digits, - or _");
  using std::filesystem::perms;
  const perms others =
      std::filesystem::status(file, error).permissions() & (perms::group_all | perms::others_all);
  if (others != perms::none)
    warning = file.string() + " holds a secret that others may read; take it from them with chmod 600";
  return token;
}

}  // namespace fathom::web
