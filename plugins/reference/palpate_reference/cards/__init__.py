"""Material cards for programs of finite elements."""
