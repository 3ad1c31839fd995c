#include "telemetry/web/request_parser.hpp"

#include <algorithm>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/string_body.hpp>
#include <limits>

namespace fathom::web {

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
