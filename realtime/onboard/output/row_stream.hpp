#pragma once

#include <cstdint>
#include <ostream>
#include <span>
#include <streambuf>
#include <string>

namespace fathom::onboard {

// A stream into memory for one row at a time; reused for the next row, it keeps its buffer and its format.
class RowStream : public std::ostream {
 public:
  RowStream() : std::ostream(nullptr) { rdbuf(&buffer_); }

  RowStream& begin() {
    buffer_.text.clear();
    return *this;
  }
  [[nodiscard]] std::span<const std::uint8_t> row() const {
    return {reinterpret_cast<const std::uint8_t*>(buffer_.text.data()), buffer_.text.size()};
  }

 private:
  struct Buffer : std::streambuf {
    int_type overflow(int_type c) override {
      if (!traits_type::eq_int_type(c, traits_type::eof())) text.push_back(traits_type::to_char_type(c));
      return traits_type::not_eof(c);
    }
    std::streamsize xsputn(const char* from, std::streamsize count) override {
      text.append(from, static_cast<std::size_t>(count));
      return count;
    }
    std::string text;
  };
  Buffer buffer_;
};

}  // namespace fathom::onboard
