"""The page in Chromium on a real server; a package, so that both end before other tests begin."""
