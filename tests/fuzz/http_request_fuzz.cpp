// A client's bytes in pieces of any size (the first byte), as the web servers read them: nothing beyond the
// bounds is kept.
#include <algorithm>
#include <cstdlib>

#include "telemetry/web/exchange.hpp"
#include "telemetry/web/page_server.hpp"

using namespace fathom;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using Step = web::RequestParser::Step;
  constexpr std::size_t kMaxBody = 64;
  if (size == 0) return 0;
  const std::size_t piece = std::size_t{data[0]} + 1;
  std::string_view left(reinterpret_cast<const char*>(data) + 1, size - 1);
  web::RequestParser parser(kMaxBody);
  const web::Access access("0123456789abcdef");
  while (!left.empty()) {
    Step step = parser.take(left.substr(0, piece));
    left.remove_prefix(std::min(piece, left.size()));
    if (step == Step::kHead) {
      (void)access.judge(parser.head());
      step = parser.take({});
    }
    if (step == Step::kRefused) {
      if (parser.status() < web::status::kBadRequest || parser.why().empty()) std::abort();
      return 0;
    }
    if (step == Step::kMore) continue;
    if (parser.request().body.size() > kMaxBody || !parser.request().path.starts_with('/')) std::abort();
    (void)web::fileInside("/nowhere", parser.request().path.substr(1));
    return 0;
  }
  return 0;
}
