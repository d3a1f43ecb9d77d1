"""Logs of any format: what a device that reads them answers, and a pipeline that reads one."""
