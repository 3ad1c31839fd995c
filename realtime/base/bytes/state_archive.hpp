#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"

namespace fathom::rt {

// Saved state of a program as bytes: written by StateWriter, read back by StateReader. A class lists its
// members once, for writing and reading:
//
//   static void exchange(auto& archive, auto& self) { archive(self.size_, self.items_); }
//
// (`self` is const when writing)
//
// or has members save(StateWriter&) const and load(StateReader&) where the two differ. Numbers are stored in
// the machine's representation: the bytes are for the same program on the same computer, and every section
// carries a version that changes with its content.
//
// Supported members: arithmetic types, enumerations (with a bound: see enumeration()), std::array, vector,
// string, optional, pair, map, set; types with exchange() or save()/load(); and types with a function
// exchangeState(archive, value) in their namespace.

// Types with values that their bytes represent uniquely, without padding.
template <typename T>
concept PlainState = !std::same_as<std::remove_const_t<T>, bool> &&
                     (std::is_arithmetic_v<T> ||
                      (std::is_trivially_copyable_v<T> && std::has_unique_object_representations_v<T>));

template <typename T, typename Archive>
concept ExchangedByMember = requires(Archive& archive, T& value) {
  T::exchange(archive, value);
};
template <typename T, typename Archive>
concept ExchangedBeside = requires(Archive& archive, T& value) {
  exchangeState(archive, value);
};
template <typename T>
concept SavedByMember = requires(const T& value, StateWriter& writer) {
  value.save(writer);
};
template <typename T>
concept LoadedByMember = requires(T& value, StateReader& reader) {
  { value.load(reader) } -> std::same_as<bool>;
};

// Head of a section: tag, version of its layout, length and checksum of its bytes.
struct StateSectionHead {
  std::uint32_t tag = 0, version = 0;
  std::uint64_t bytes = 0;
  std::uint32_t crc = 0, unused = 0;
};
static_assert(std::has_unique_object_representations_v<StateSectionHead>);

[[nodiscard]] constexpr std::uint32_t stateTag(const char (&text)[5]) noexcept {
  return static_cast<std::uint32_t>(text[0]) | static_cast<std::uint32_t>(text[1]) << 8 |
         static_cast<std::uint32_t>(text[2]) << 16 | static_cast<std::uint32_t>(text[3]) << 24;
}

// Writes into the caller's buffer and never beyond it. Data that does not fit is left out; full() then
// reports it.
class StateWriter {
 public:
  static constexpr bool kLoading = false;

  explicit StateWriter(std::span<std::uint8_t> buffer) noexcept : buffer_(buffer) {}

  template <typename... T>
  void operator()(const T&... values) {
    (one(values), ...);
  }
  void bytes(const void* data, std::size_t count) noexcept {
    if (count > buffer_.size() - size_) {
      full_ = true;
      needed_ += count;
      return;
    }
    if (count > 0) std::memcpy(buffer_.data() + size_, data, count);
    size_ += count;
  }
  // Elements without their number.
  template <typename T>
  void elements(const T* values, std::size_t count) {
    if constexpr (PlainState<T>)
      bytes(values, count * sizeof(T));
    else
      for (std::size_t i = 0; i < count; ++i) one(values[i]);
  }
  // Counterparts of StateReader's functions, which check.
  template <typename T>
  void fixed(const std::vector<T>& values) {
    sequence(values);
  }
  template <typename T>
  void bounded(const std::vector<T>& values, std::size_t) {
    sequence(values);
  }
  template <typename E>
  void enumeration(const E& value, E) {
    bytes(&value, sizeof value);
  }
  template <typename... T>
  void instants(const T&... values) {
    (one(values), ...);
  }
  void require(bool, const char*) noexcept {}

  // Runs `content` as a section. Sections cannot be nested.
  template <typename Content>
  void section(std::uint32_t tag, std::uint32_t version, const Content& content) {
    const std::size_t head = beginSection();
    content();
    endSection(head, tag, version);
  }

  [[nodiscard]] bool full() const noexcept { return full_; }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  // Bytes that the buffer would have needed, at least.
  [[nodiscard]] std::size_t needed() const noexcept { return size_ + needed_; }
  [[nodiscard]] std::span<const std::uint8_t> written() const noexcept { return buffer_.first(size_); }

 private:
  template <typename T>
  void one(const T& value);
  template <typename Range>
  void sequence(const Range& values) {
    one(static_cast<std::uint64_t>(values.size()));
    if constexpr (requires { values.data(); })
      elements(values.data(), values.size());
    else
      for (const auto& value : values) one(value);
  }
  std::size_t beginSection() noexcept;
  void endSection(std::size_t head, std::uint32_t tag, std::uint32_t version) noexcept;

  std::span<std::uint8_t> buffer_;
  std::size_t size_ = 0, needed_ = 0;
  bool full_ = false;
};

// Reads untrusted bytes. After the first error no value changes any more and ok() is false. An object is in
// an undefined state after its load() failed: discard it, load another state, or construct it again.
class StateReader {
 public:
  static constexpr bool kLoading = true;

  explicit StateReader(std::span<const std::uint8_t> bytes) noexcept : bytes_(bytes), end_(bytes.size()) {}

  template <typename... T>
  bool operator()(T&... values) {
    (one(values), ...);
    return ok();
  }
  void bytes(void* data, std::size_t count) noexcept {
    if (count > left()) fail("it ends early");
    if (!ok()) return;
    if (count > 0) std::memcpy(data, bytes_.data() + at_, count);
    at_ += count;
  }
  template <typename T>
  void elements(T* values, std::size_t count) {
    if constexpr (PlainState<T>)
      bytes(values, count * sizeof(T));
    else
      for (std::size_t i = 0; i < count && ok(); ++i) one(values[i]);
  }
  // A vector of fixed size.
  template <typename T>
  void fixed(std::vector<T>& values) {
    if (count(values.size()) != values.size()) fail("a list has another length");
    elements(values.data(), values.size());
  }
  // A vector of at most `most` elements.
  template <typename T>
  void bounded(std::vector<T>& values, std::size_t most) {
    const std::size_t size = count(most);
    if (!ok()) return;
    values.clear();
    values.resize(size);
    elements(values.data(), values.size());
  }
  // An enumeration that begins at 0 and ends with `last`.
  template <typename E>
  void enumeration(E& value, E last) {
    std::underlying_type_t<E> number{};
    one(number);
    if (static_cast<std::uint64_t>(number) > static_cast<std::uint64_t>(last))
      fail("a kind that there is not");
    if (ok()) value = static_cast<E>(number);
  }
  // Times [ns] whose differences do not overflow.
  template <typename... T>
  void instants(T&... values) {
    (one(values), ...);
    constexpr std::int64_t kFarthest = std::int64_t{1} << 62;
    require(((values > -kFarthest && values < kFarthest) && ...), "a time that cannot be");
  }
  // Fails with the reason `else_why` (a literal) unless `holds`.
  void require(bool holds, const char* else_why) noexcept {
    if (!holds) fail(else_why);
  }

  // As the writer's; `content` must consume the whole section.
  template <typename Content>
  bool section(std::uint32_t tag, std::uint32_t version, const Content& content) {
    beginSection(tag, version);
    if (ok()) content();
    endSection();
    return ok();
  }
  // Whether all following sections have their full length and the right checksum; does not advance.
  [[nodiscard]] bool sectionsAreWhole() const noexcept;

  // `why`: a literal. The first failure is kept.
  void fail(const char* why) noexcept {
    if (failure_ == nullptr) failure_ = why;
  }
  [[nodiscard]] bool ok() const noexcept { return failure_ == nullptr; }
  [[nodiscard]] const char* failure() const noexcept { return failure_ == nullptr ? "" : failure_; }
  [[nodiscard]] std::size_t left() const noexcept { return end_ - at_; }  // in the section

 private:
  template <typename T>
  void one(T& value);
  // Number of elements that follows; fails if it exceeds `most` or the bytes left.
  std::size_t count(std::size_t most) noexcept {
    std::uint64_t size = 0;
    bytes(&size, sizeof size);
    if (size > most || size > left()) fail("a list is too long");
    return ok() ? static_cast<std::size_t>(size) : 0;
  }
  void beginSection(std::uint32_t tag, std::uint32_t version) noexcept;
  void endSection() noexcept;

  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0, end_;
  const char* failure_ = nullptr;
};

namespace detail {

template <typename T>
inline constexpr bool kIsVector = false;
template <typename T>
inline constexpr bool kIsVector<std::vector<T>> = true;
template <typename T>
inline constexpr bool kIsArray = false;
template <typename T, std::size_t N>
inline constexpr bool kIsArray<std::array<T, N>> = true;
template <typename T>
inline constexpr bool kIsOptional = false;
template <typename T>
inline constexpr bool kIsOptional<std::optional<T>> = true;
template <typename T>
inline constexpr bool kIsPair = false;
template <typename A, typename B>
inline constexpr bool kIsPair<std::pair<A, B>> = true;
template <typename T>
inline constexpr bool kIsMap = false;
template <typename K, typename V>
inline constexpr bool kIsMap<std::map<K, V>> = true;
template <typename T>
inline constexpr bool kIsSet = false;
template <typename K>
inline constexpr bool kIsSet<std::set<K>> = true;

}  // namespace detail

template <typename T>
void StateWriter::one(const T& value) {
  if constexpr (std::same_as<T, bool>) {
    const std::uint8_t byte = value ? 1 : 0;
    bytes(&byte, 1);
  } else if constexpr (SavedByMember<T>) {
    value.save(*this);
  } else if constexpr (ExchangedByMember<const T, StateWriter>) {
    T::exchange(*this, value);
  } else if constexpr (ExchangedBeside<const T, StateWriter>) {
    exchangeState(*this, value);
  } else if constexpr (detail::kIsVector<T> || detail::kIsMap<T> || detail::kIsSet<T> ||
                       std::same_as<T, std::string>) {
    sequence(value);
  } else if constexpr (detail::kIsArray<T>) {
    elements(value.data(), value.size());
  } else if constexpr (detail::kIsOptional<T>) {
    one(value.has_value());
    if (value) one(*value);
  } else if constexpr (detail::kIsPair<T>) {
    one(value.first);
    one(value.second);
  } else {
    static_assert(PlainState<T>, "say how it is saved: exchange(), save() or exchangeState()");
    static_assert(!std::is_enum_v<T>, "say its last value: enumeration()");
    bytes(&value, sizeof value);
  }
}

template <typename T>
void StateReader::one(T& value) {
  if (!ok()) return;
  if constexpr (std::same_as<T, bool>) {
    std::uint8_t byte = 0;
    bytes(&byte, 1);
    if (byte > 1) fail("neither yes nor no");
    if (ok()) value = byte == 1;
  } else if constexpr (LoadedByMember<T>) {
    if (!value.load(*this)) fail("a part of it is wrong");
  } else if constexpr (ExchangedByMember<T, StateReader>) {
    T::exchange(*this, value);
  } else if constexpr (ExchangedBeside<T, StateReader>) {
    exchangeState(*this, value);
  } else if constexpr (detail::kIsVector<T> || std::same_as<T, std::string>) {
    const std::size_t size = count(left());
    if (!ok()) return;
    value.clear();
    value.resize(size);
    elements(value.data(), size);
  } else if constexpr (detail::kIsMap<T> || detail::kIsSet<T>) {
    // Entries were written in rising order; a repeated one is damage.
    const std::size_t size = count(left());
    value.clear();
    for (std::size_t i = 0; i < size && ok(); ++i) {
      if constexpr (detail::kIsMap<T>) {
        std::pair<typename T::key_type, typename T::mapped_type> entry;
        one(entry);
        value.insert_or_assign(value.end(), entry.first, std::move(entry.second));
      } else {
        typename T::key_type entry{};
        one(entry);
        value.insert(value.end(), std::move(entry));
      }
    }
    if (value.size() != size) fail("an entry comes twice");
  } else if constexpr (detail::kIsArray<T>) {
    elements(value.data(), value.size());
  } else if constexpr (detail::kIsOptional<T>) {
    bool there = false;
    one(there);
    value.reset();
    if (there && ok()) one(value.emplace());
  } else if constexpr (detail::kIsPair<T>) {
    one(value.first);
    one(value.second);
  } else {
    static_assert(PlainState<T>, "say how it is loaded: exchange(), load() or exchangeState()");
    static_assert(!std::is_enum_v<T>, "say its last value: enumeration()");
    bytes(&value, sizeof value);
  }
}

}  // namespace fathom::rt
