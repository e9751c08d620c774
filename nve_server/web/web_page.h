#pragma once

namespace telenano::web {

/// The one static page: markup, style and script. It asks no other host for anything.
extern const char* const kPageHtml;
extern const char* const kPageCss;
extern const char* const kPageJs;

}  // namespace telenano::web
