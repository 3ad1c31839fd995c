#include "realtime/kernel/printable_text.hpp"

#include <gtest/gtest.h>

#include "realtime/kernel/input_error.hpp"

namespace fathom {
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
