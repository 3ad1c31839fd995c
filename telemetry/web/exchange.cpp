#include "telemetry/web/exchange.hpp"

#include <algorithm>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/string_body.hpp>
#include <cerrno>
#include <charconv>
#include <limits>

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

namespace asio = boost::asio;
namespace http = boost::beast::http;

namespace {

std::string_view view(boost::beast::string_view text) {
  return {text.data(), text.size()};
}

}  // namespace

struct RequestParser::Impl {
  http::request_parser<http::string_body> parser;
  std::string waiting;  // bytes that the parser has not taken

  template <class Name>
  [[nodiscard]] std::string_view header(Name name) const {
    return view(parser.get()[name]);
  }
};

RequestParser::RequestParser(std::size_t max_body_bytes)
    : impl_(std::make_unique<Impl>()), max_body_bytes_(max_body_bytes) {
  impl_->parser.header_limit(kMaxHeadBytes);
  // checkBody() limits the body, after Access has answered for the head. (Without any limit this Beast
  // refuses every body.)
  impl_->parser.body_limit(std::numeric_limits<std::uint64_t>::max());
}

RequestParser::~RequestParser() = default;

RequestParser::Step RequestParser::refuse(int status, const char* why) {
  status_ = status;
  why_ = why;
  return Step::kRefused;
}

RequestParser::Step RequestParser::take(std::string_view bytes) {
  auto& parser = impl_->parser;
  auto& waiting = impl_->waiting;
  if (parser.is_header_done() && !body_checked_)
    if (const Step step = checkBody(); step != Step::kMore) return step;
  waiting.append(bytes);
  while (!parser.is_done() && !waiting.empty()) {
    const bool had_head = parser.is_header_done();
    boost::system::error_code error;
    waiting.erase(0, parser.put(asio::buffer(waiting), error));
    if (error == http::error::header_limit ||
        (error == http::error::need_more && waiting.size() >= kMaxHeadBytes))
      return refuse(status::kHeadTooLarge, "The request's head is too large.");
    if (error == http::error::need_more) return Step::kMore;
    if (error) return refuse(status::kBadRequest, "This is no HTTP request.");
    if (!had_head && parser.is_header_done()) return readHead();
  }
  if (!parser.is_done()) return Step::kMore;
  request_.body = std::move(parser.get().body());
  return Step::kWhole;
}

RequestParser::Step RequestParser::readHead() {
  const auto& message = impl_->parser.get();
  const std::string_view target = view(message.target());
  const std::size_t question = std::min(target.find('?'), target.size());
  const auto path = percentDecoded(target.substr(0, question));
  if (!path || !path->starts_with('/') || message.count(http::field::host) > 1)
    return refuse(status::kBadRequest, "This is no request to this server.");
  request_.method = view(message.method_string());
  request_.path = *path;
  request_.query = target.substr(std::min(question + 1, target.size()));
  request_.range = impl_->header(http::field::range);
  token_ = request_.parameter("token");
  return Step::kHead;
}

AccessRequest RequestParser::head() const {
  const auto& message = impl_->parser.get();
  return {.method = request_.method,
          .host = impl_->header(http::field::host),
          .cookie = impl_->header(http::field::cookie),
          .token_header = impl_->header(kTokenHeader),
          .token_query = token_,
          .fetch_site = impl_->header("Sec-Fetch-Site"),
          .has_page_header = message.find(kPageHeader) != message.end()};
}

RequestParser::Step RequestParser::checkBody() {
  auto& parser = impl_->parser;
  body_checked_ = true;
  const auto length = parser.content_length();
  if (parser.get().count(http::field::transfer_encoding) > 0)
    return refuse(status::kNeedsLength, "A body needs its Content-Length.");
  if (length && *length > max_body_bytes_) return refuse(status::kTooLarge, "The body is too large.");
  if (parser.get().count(http::field::content_encoding) > 0)
    return refuse(status::kBadEncoding, "Bodies are taken as they are, without a Content-Encoding.");
  parser.eager(true);
  return Step::kMore;
}

}  // namespace fathom::web
