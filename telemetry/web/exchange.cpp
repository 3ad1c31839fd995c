#include "telemetry/web/exchange.hpp"

#include <cerrno>
#include <charconv>

namespace fathom::web {

std::optional<std::string> percentDecoded(std::string_view text) {
  constexpr std::size_t kDigits = 2;
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out += text[i];
      continue;
    }
    const std::string_view digits = text.substr(i + 1, kDigits);
    unsigned char byte = 0;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), byte, 16);
    if (digits.size() < kDigits || error != std::errc() || end != digits.data() + kDigits)
      return std::nullopt;
    out += static_cast<char>(byte);
    i += kDigits;
  }
  return out;
}

std::string HttpRequest::parameter(std::string_view name) const {
  std::string_view left = query;
  while (!left.empty()) {
    const std::string_view one = left.substr(0, left.find('&'));
    left.remove_prefix(std::min(left.size(), one.size() + 1));
    const std::size_t equals = one.find('=');
    if (one.substr(0, equals) == name && equals != std::string_view::npos)
      return percentDecoded(one.substr(equals + 1)).value_or("");
  }
  return {};
}

std::size_t OpenFile::read(std::uint64_t offset, char* to, std::size_t size) const {
  ssize_t got = 0;
  do got = ::pread(file_.get(), to, size, static_cast<off_t>(offset));
  while (got < 0 && errno == EINTR);
  return got > 0 ? static_cast<std::size_t>(got) : 0;
}

Response answer(std::string body, std::string type) {
  Response response;
  response.body = std::move(body);
  response.type = std::move(type);
  return response;
}

Response refusal(int status, std::string_view why) {
  Response response = answer(std::string(why) + "\n", "text/plain");
  response.status = status;
  return response;
}

void Routes::get(std::string path, Handler handler, Work work) {
  routes_.push_back({"GET", std::move(path), false, false, work, std::move(handler)});
}

void Routes::getBelow(std::string prefix, Handler handler) {
  routes_.push_back({"GET", std::move(prefix), true, false, Work::kShort, std::move(handler)});
}

void Routes::post(std::string path, Handler handler) {
  routes_.push_back({"POST", std::move(path), false, false, Work::kShort, std::move(handler)});
}

void Routes::events(std::string path) {
  routes_.push_back({"GET", std::move(path), false, true, Work::kShort, {}});
}

const Routes::Route* Routes::find(std::string_view method, std::string_view path) const {
  if (method == "HEAD") method = "GET";
  const Route* best = nullptr;
  for (const Route& route : routes_) {
    if (route.method != method) continue;
    if (!route.prefix && path == route.path) return &route;
    if (route.prefix && path.starts_with(route.path) &&
        (best == nullptr || route.path.size() > best->path.size()))
      best = &route;
  }
  return best;
}

}  // namespace fathom::web
