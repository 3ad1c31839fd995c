#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace fathom::web {

// The parts of a request that decide its access. Absent headers are empty.
struct AccessRequest {
  std::string_view method;  // "GET", "POST"
  std::string_view host;    // header Host
  std::string_view cookie;  // header Cookie
  std::string_view token_header, token_query;
  std::string_view fetch_site;   // header Sec-Fetch-Site: the origin of the request
  bool has_page_header = false;  // kPageHeader, which no other site's page can send
};

enum class AccessVerdict { kEnter, kEnterAndSetCookie, kUnauthorised, kForbidden };

inline constexpr const char* kPageHeader = "X-Fathom";
inline constexpr const char* kTokenHeader = "X-Fathom-Token";

// Access to the page. With a token every request must have it: in a header, in the cookie that the page's
// first address (?token=...) sets, or in the address. Without a token (loopback only) the request must name
// this machine as its host, so that another site's name cannot be resolved to it. Requests other than GET and
// HEAD also need the page's header, and must not come from another site by Sec-Fetch-Site.
class Access {
 public:
  explicit Access(std::string token) : token_(std::move(token)) {}
  [[nodiscard]] AccessVerdict judge(const AccessRequest& request) const;
  [[nodiscard]] const std::string& token() const { return token_; }
  // The Set-Cookie header with the token.
  [[nodiscard]] std::string setCookie() const;

 private:
  [[nodiscard]] bool matches(std::string_view given) const;
  std::string token_;
};

[[nodiscard]] bool isLoopback(std::string_view address);  // an address or name, without a port
// 128 random bits in hex.
[[nodiscard]] std::string makeToken();
// The token that a file holds, one line of 8 to 128 letters, digits, - or _. `warning`: others may read the
// file. Throws InputError for a file that cannot be read or holds anything else.
[[nodiscard]] std::string readToken(const std::filesystem::path& file, std::string& warning);

}  // namespace fathom::web
