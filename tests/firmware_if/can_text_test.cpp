// Text captures line by line, in every form.
#include "firmware_if/devices/can/can_text.hpp"

#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <vector>

#include "firmware_if/devices/can/can_text.hpp"

namespace fathom::io {
namespace {

using Bytes = std::vector<std::uint8_t>;

TEST(Candump, LogAndScreenFormGiveTheSameFrame) {
  for (const char* line :
       {"(1502984866.421964) slcan0 09F112CC#FF725AFF7FFF7FFD",
        "(1502984866.421964) slcan0 09F112CC#FF.72.5A.FF.7F.FF.7F.FD\r",
        " (1502984866.421964)  slcan0  09F112CC   [8]  FF 72 5A FF 7F FF 7F FD",
        " (1502984866.421964)  can0  RX - -  09F112CC   [8]  FF 72 5A FF 7F FF 7F FD   '.rZ.....'"}) {
    CanFrame frame;
    ASSERT_EQ(parseCandumpLine(line, frame), CanLine::kFrame) << line;
    EXPECT_EQ(frame.utc_ns, 1'502'984'866'421'964'000) << line;
    EXPECT_EQ(frame.id, 0x09F112CCU);
    EXPECT_EQ(Bytes(frame.bytes().begin(), frame.bytes().end()),
              (Bytes{0xFF, 0x72, 0x5A, 0xFF, 0x7F, 0xFF, 0x7F, 0xFD}));
  }
}

TEST(Candump, ATimeThatIsMissingOrNotInSecondsIsAbsent) {
  CanFrame frame;
  ASSERT_EQ(parseCandumpLine("can0  09F112CC  [2]  01 02", frame), CanLine::kFrame);
  EXPECT_FALSE(frame.utc_ns);
  ASSERT_EQ(parseCandumpLine(" (2017-08-17 15:47:46.421964)  can0  09F112CC  [0]", frame), CanLine::kFrame);
  EXPECT_FALSE(frame.utc_ns);
  ASSERT_EQ(parseCandumpLine("(99999999999999999999.0) can0 09F112CC#", frame), CanLine::kFrame);
  EXPECT_FALSE(frame.utc_ns);
  ASSERT_EQ(parseCandumpLine("(0000000000.352000) can0 09F112CC#", frame), CanLine::kFrame);
  EXPECT_EQ(frame.utc_ns, 352'000'000);
}

TEST(Candump, WhatIsNoExtendedDataFrameIsOtherAndNotBroken) {
  CanFrame frame;
  for (const char* other : {"(1.0) can0 123#0102", "(1.0) can0 09F112CC#R", "(1.0) can0 09F112CC##311223344",
                            "(1.0) can0 20000004#0000000000000000", "can0  123  [2]  01 02",
                            "can0  09F112CC   [2]  remote request", "can0  09F112CC  [12]  00 11"}) {
    EXPECT_EQ(parseCandumpLine(other, frame), CanLine::kOther) << other;
  }
  for (const char* broken :
       {"(1.0 can0 09F112CC#00", "(1.0) can0", "can0", "(1.0) can0 09F112C#00", "(1.0) can0 09F112CC#0",
        "(1.0) can0 09F112CC#0G", "(1.0) can0 09F112CC#001122334455667788", "can0 09F112CC [3] 01 02",
        "can0 09F112CC [9] 01", "can0 09F112CC 01 02", "()", "( ) a b"}) {
    EXPECT_EQ(parseCandumpLine(broken, frame), CanLine::kBroken) << broken;
  }
  for (const char* blank : {"", "   ", "\r", "# a comment"})
    EXPECT_EQ(parseCandumpLine(blank, frame), CanLine::kBlank) << blank;
}

TEST(Candump, TheReaderTakesLinesCutAnywhereAndALastOneWithoutItsEnd) {
  const std::string text = "(1.0) can0 09F112CC#01\n(2.0) can0 09F112CC#02\r\nnonsense\n" +
                           std::string(5000, 'x') + "\n(3.0) can0 09F112CC#03";
  for (const std::size_t piece : {1U, 3U, 10000U}) {
    CanTextReader reader;
    Bytes read;
    const auto take = [&](const CanFrame& frame) { read.push_back(frame.data[0]); };
    for (std::size_t at = 0; at < text.size(); at += piece) {
      const std::string part = text.substr(at, piece);
      reader.feed({reinterpret_cast<const std::uint8_t*>(part.data()), part.size()}, take);
    }
    reader.drain(take);
    EXPECT_EQ(read, (Bytes{1, 2, 3}));
    EXPECT_EQ(reader.counts().broken, 2U);
  }
}

// Every part of a text as "frame PGN SOURCE DESTINATION PRIORITY BYTES" or "whole ..."; times apart.
struct TextParts {
  std::vector<std::string> parts;
  std::vector<std::optional<std::int64_t>> times;
  CanTextReader::Counts counts;
};
TextParts readText(const std::string& text) {
  TextParts out;
  CanTextReader reader;
  const auto part = [&](const char* kind, const N2kId& id, const auto& holder) {
    std::string line = std::string(kind) + " " + std::to_string(id.pgn) + " " + std::to_string(id.source) +
                       " " + std::to_string(id.destination) + " " + std::to_string(id.priority);
    for (const std::uint8_t byte : holder.bytes()) line += " " + std::to_string(byte);
    out.parts.push_back(line);
    out.times.push_back(holder.utc_ns);
  };
  const auto frame = [&](const CanFrame& f) { part("frame", parseN2kId(f.id), f); };
  const auto packet = [&](const N2kPacket& p) { part("whole", p.id, p); };
  reader.feed({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}, frame, packet);
  reader.drain(frame, packet);
  out.counts = reader.counts();
  return out;
}

TEST(CanText, TheFormsOfGatewaysGiveWhatCandumpGives) {
  const std::string heading = "frame 127250 204 255 2 255 114 90 255 127 255 127 253";
  const TextParts all = readText(
      "(1708146949.768) can0 09F112CC#FF725AFF7FFF7FFD\n"
      "2024-02-17T05:15:49.768Z,2,127250,204,255,8,ff,72,5a,ff,7f,ff,7f,fd\r\n"
      "2024-02-17-05:15:49.768,2,127250,204,255,8,FF,72,5A,FF,7F,FF,7F,FD\n"
      "# a comment\n\n"
      "05:15:49.768 R 09F112CC FF 72 5A FF 7F FF 7F FD\r\n"
      "05:15:49.768 T 09F112CC FF 72 5A FF 7F FF 7F FD\n"
      "A051549.768 CCFF2 1F112 FF725AFF7FFF7FFD\r\n");
  EXPECT_EQ(all.parts, (std::vector<std::string>{heading, heading, heading, heading, heading,
                                                 "whole" + heading.substr(5)}));
  const std::int64_t time = 1'708'146'949'768'000'000;
  EXPECT_EQ(all.times, (decltype(all.times){time, time, time, std::nullopt, std::nullopt, std::nullopt}));
  EXPECT_EQ(all.counts.frames, 5U);
  EXPECT_EQ(all.counts.packets, 1U);
  EXPECT_EQ(all.counts.broken, 0U);
}

TEST(CanText, AddressedMessagesKeepTheirDestination) {
  const TextParts all = readText(
      "2024-02-17T05:15:49Z,6,59904,172,204,3,14,f0,01\n"
      "05:15:49.768 R 18EACCAC 14 F0 01\n"
      "A051549.768 ACCC6 0EA00 14F001\n");
  const std::string request = "59904 172 204 6 20 240 1";
  EXPECT_EQ(all.parts,
            (std::vector<std::string>{"frame " + request, "frame " + request, "whole " + request}));
}

TEST(CanText, CanboatsLinesAreWholeMessagesOnceOneIsTooLongForAFrame) {
  const std::string eight = "2024-02-17T05:15:49Z,6,130820,1,255,8,e5,98,0b,00,00,00,00,00\n";
  const std::string nine = "2024-02-17T05:15:49Z,6,130820,1,255,9,e5,98,0b,00,00,00,00,00,00\n";
  const TextParts all = readText(eight + nine + eight);
  ASSERT_EQ(all.parts.size(), 3U);
  EXPECT_TRUE(all.parts[0].starts_with("frame 130820"));
  EXPECT_TRUE(all.parts[1].starts_with("whole 130820"));
  EXPECT_TRUE(all.parts[2].starts_with("whole 130820"));
}

TEST(CanText, TheLongestMessageOfEachFormIsReadAndALongerOneIsBroken) {
  for (const int size : {223, 224}) {
    std::string canboat = "2024-02-17T05:15:49.768Z,7,130823,254,255," + std::to_string(size),
                actisense = "A051549.768 FEFF7 1FF07 ";
    for (int k = 0; k < size; ++k) {
      canboat += ",a5";
      actisense += "A5";
    }
    const TextParts all = readText(canboat + "\n" + actisense);
    EXPECT_EQ(all.counts.packets, size == 223 ? 2U : 0U);
    EXPECT_EQ(all.counts.broken, size == 223 ? 0U : 2U);
  }
}

TEST(CanText, WhatIsNoneOfTheFormsIsBrokenAndAGatewaysOwnGroupIsOther) {
  for (const char* broken : {"2024-02-17T05:15:49.768Z,2,127250,204,255,8,ff,72",
                             "2024-02-17T05:15:49.768Z,2,127250,204,255",
                             "2024-02-17T05:15:49.768Z,2,127250,204,255,1,ff,72",
                             "2024-02-17T05:15:49.768Z,2,127250,204,256,1,ff",
                             "2024-02-17T05:15:49.768Z,8,127250,204,255,1,ff",
                             "2024-02-17T05:15:49.768Z,-2,127250,204,255,1,ff",
                             "2024-02-17T05:15:49.768Z,2,127250,204,255,1,f",
                             "2024-02-17T05:15:49.768Z,2,127250,204,255,1,fg",
                             "2024-02-17T05:15:49.768Z,",
                             "05:15:49.768 X 09F112CC FF",
                             "05:15:49.768 R 09F112C FF",
                             "05:15:49.768 R 09F112CC F",
                             "05:15:49.768 R 09F112CC 1 2 3 4 5 6 7 8 9",
                             "05:15:49.768",
                             "A051549.768 CCFF2 1F112 FF7",
                             "A051549.768 CCFF9 1F112 FF",
                             "A051549.768 CCFF2",
                             "A051549.768 1CCFF2 1F112 FF",
                             "A051549.768 ",
                             "2024-02-17 can0 09F112CC"}) {
    const TextParts all = readText(broken);
    EXPECT_EQ(all.counts.broken, 1U) << broken;
    EXPECT_TRUE(all.parts.empty()) << broken;
  }
  for (const char* other : {"2024-02-17T05:15:49.768Z,0,262386,0,255,2,01,02", "05:15:49.768 R 29F112CC FF",
                            "A051549.768 00FF0 400F2 0102"})
    EXPECT_EQ(readText(other).counts.other, 1U) << other;
}

TEST(CanText, AMomentThatDoesNotExistIsAbsent) {
  for (const char* moment : {"2024-02-30T05:15:49Z", "2024-02-17T25:15:49Z", "2024-02-17",
                             "2024-02-17T05:15:49.Z", "2024-02-17T05:15:49+01:00", "9999-02-17T05:15:49Z"}) {
    const TextParts all = readText(std::string(moment) + ",2,127250,204,255,1,ff");
    ASSERT_EQ(all.parts.size(), 1U) << moment;
    EXPECT_FALSE(all.times[0]) << moment;
  }
}

}  // namespace
}  // namespace fathom::io
