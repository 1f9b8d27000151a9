#pragma once

#include <gtest/gtest.h>

#include <initializer_list>
#include <string>

#include "revisit/base/error.h"

namespace revisit::test {

/// Returns the message; fails the test if `action` does not throw `Wanted`.
template <class Wanted, class Action>
std::string message_of(Action&& action) {
  try {
    action();
  } catch (const Wanted& error) {
    return error.what();
  } catch (const std::exception& error) {
    ADD_FAILURE() << "another kind of error: " << error.what();
    return "";
  }
  ADD_FAILURE() << "no error";
  return "";
}

/// The message must contain all `parts`.
template <class Wanted, class Action>
void expect_error(Action&& action, std::initializer_list<std::string> parts) {
  const std::string message = message_of<Wanted>(action);
  for (const std::string& part : parts)
    EXPECT_NE(message.find(part), std::string::npos) << "no \"" << part << "\" in: " << message;
}

}  // namespace revisit::test

#define EXPECT_HAS(text, part) \
  EXPECT_NE((text).find(part), std::string::npos) << "'" << (text) << "' lacks '" << (part) << "'"
