#include <gtest/gtest.h>

#include "realtime/base/config_table.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom {
namespace {

using test::refusal;

TEST(ConfigTable, GivesValuesOfTheFileAndDefaultsForWhatItLacks) {
  const ConfigTable t =
      ConfigTable::parse("a = 2\nb = 1.5\nc = 'x'\nd = true\ne = [1, 2.5]\n[sub]\nk = 7\n", "f.toml");
  EXPECT_EQ(t.number("a", 0, 0, 10), 2.0);
  EXPECT_EQ(t.number("b", 0, 0, 10), 1.5);
  EXPECT_EQ(t.text("c", ""), "x");
  EXPECT_TRUE(t.boolean("d", false));
  EXPECT_EQ(t.requiredNumbers("e", 2, 0, 3), (std::vector<double>{1, 2.5}));
  EXPECT_EQ(t.table("sub").integer("k", 0, 0, 9), 7);
  EXPECT_EQ(t.table("none").integer("k", 3, 0, 9), 3);
  EXPECT_EQ(t.integer("absent", 4, 0, 9), 4);
  t.finish();
}

TEST(ConfigTable, RefusalsNameFileLineKeyAndRange) {
  const ConfigTable t = ConfigTable::parse("\na = 20\nb = 'x'\nn = nan\n[s]\nz = 1\n", "f.toml");
  EXPECT_EQ(refusal([&] { (void)t.number("a", 0, 0, 10); }),
            "f.toml: line 2, key 'a': 20 is out of range; give 0 to 10");
  EXPECT_NE(refusal([&] { (void)t.integer("b", 0, 0, 1); }).find("whole number"), std::string::npos);
  EXPECT_NE(refusal([&] { (void)t.number("n", 0, 0, 1); }).find("out of range"), std::string::npos);
  EXPECT_NE(refusal([&] { (void)t.requiredText("q"); }).find("'q': is missing"), std::string::npos);
  EXPECT_NE(refusal([&] { (void)t.table("s").requiredNumber("y", 0, 1); }).find("'s.y'"), std::string::npos);
  EXPECT_NE(refusal([&] { (void)t.choice("b", "", {"p", "q"}); }).find("none of: p, q"), std::string::npos);
}

TEST(ConfigTable, AKeyThatNobodyAskedForIsRefusedWhereverItStands) {
  const ConfigTable t =
      ConfigTable::parse("a = 1\n[s]\nk = 1\nmisspelt = 2\n[[p]]\nx = 1\nq = 2\n", "f.toml");
  (void)t.number("a", 0, 0, 1);
  (void)t.table("s").number("k", 0, 0, 1);
  EXPECT_NE(refusal([&] { t.finish(); }).find("line 4, key 's.misspelt': is unknown"), std::string::npos);
  (void)t.table("s").number("misspelt", 0, 0, 2);
  for (const ConfigTable& p : t.tables("p")) (void)p.number("x", 0, 0, 1);
  EXPECT_NE(refusal([&] { t.finish(); }).find("line 7, key 'p.q'"), std::string::npos);
}

TEST(ConfigTable, ARefusalStaysOneLineWhateverTheFileHolds) {
  const std::string line = refusal([] { (void)ConfigTable::parse("a = t\n0", "f.toml"); });
  EXPECT_NE(line.find("f.toml: line"), std::string::npos);
  EXPECT_EQ(line.find('\n'), std::string::npos);
}

TEST(ConfigTable, ATimeIsReadToTheNanosecondAndOnlyInUtc) {
  const ConfigTable t = ConfigTable::parse(
      "a = 2023-11-14T22:13:20.123456789Z\nb = 2023-11-14T22:13:20+10:00\nc = 2023-11-14T22:13:20\nd = "
      "'2023'\n"
      "e = 1600-01-01T00:00:00Z\n",
      "f.toml");
  EXPECT_EQ(t.requiredUtc("a"), 1700000000123456789);
  for (const char* key : {"b", "c", "d"})
    EXPECT_NE(refusal([&] { (void)t.requiredUtc(key); }).find("in UTC"), std::string::npos) << key;
  EXPECT_NE(refusal([&] { (void)t.requiredUtc("e"); }).find("outside the years"), std::string::npos);
}

TEST(ConfigTable, AnAbsentOrBrokenFileIsRefused) {
  const test::TemporaryFolder folder;
  EXPECT_NE(refusal([&] { (void)ConfigTable::load(folder.path() / "no.toml"); }).find("cannot be read"),
            std::string::npos);
  EXPECT_NE(refusal([&] { (void)ConfigTable::load(folder.path()); }).find("cannot be read"),
            std::string::npos);
  EXPECT_NE(refusal([&] { (void)ConfigTable::parse("a = = 3", "f.toml"); }).find("line 1"),
            std::string::npos);
}

}  // namespace

namespace {

TEST(PrintableText, NamesInAnyScriptSurvive) {
  for (const char* name :
       {"", "reef 7~", "récif/пролив", "珊瑚礁.tif", "\U0001f41f.png", "\u00a0\uffee\U0010fffd"})
    EXPECT_EQ(printableText(name), name);
}

TEST(PrintableText, WhatATerminalObeysDoesNot) {
  EXPECT_EQ(printableText(std::string("a\0b", 3)), "a?b");
  EXPECT_EQ(printableText("\x1b[31mred\r\n\x7f"), "?[31mred???");
  EXPECT_EQ(printableText("\u009b31m\u0085"), "?31m?");
  EXPECT_EQ(printableText("gpj.\u202etxt\u2029\u2066"), "gpj.?txt??");
}

TEST(PrintableText, BytesThatAreNoUtf8DoNot) {
  EXPECT_EQ(printableText("II*\xff\xfe"), "II*??");
  EXPECT_EQ(printableText("\xc0\x9b\xe0\x82\x9b"), "?????");  // longer than need be
  EXPECT_EQ(printableText("\xed\xa0\x80|\xf4\x90\x80\x80|\xf8"), "???|????|?");
  EXPECT_EQ(printableText("cut \xe7\x8f"), "cut ??");
  EXPECT_EQ(printableText("\xe7\x8fx\x9b"), "??x?");
}

TEST(InputErrors, ShowPrintableCharactersAlone) {
  EXPECT_STREQ(InputError("récif.calib", "number 1", "'\x89PNG\n\x1b[2J' is not a number").what(),
               "récif.calib: number 1: '?PNG??[2J' is not a number");
}

}  // namespace
}  // namespace fathom
