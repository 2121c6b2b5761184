"""The record of a study as an agent sees it: samples, answers, marks and KPIs."""
