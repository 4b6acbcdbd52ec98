// The text of this node does not matter here: it is declared and not built.
int main() { return 0; }
